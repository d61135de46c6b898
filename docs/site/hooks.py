"""Pages that are made when the site is built: the reference of all commands, as their --help says it."""

import click
from mkdocs.structure.files import File

from skinbus.cli import GROUPS, SUBCOMMANDS, group


def _help(name):
    command = group.get_command(None, name)
    context = click.Context(command, info_name=f"skinbus {name}", max_content_width=100, terminal_width=100)
    yield name, command.get_help(context)
    for sub in getattr(command, "commands", {}):
        inner = click.Context(command.commands[sub], context, sub, max_content_width=100, terminal_width=100)
        yield f"{name} {sub}", command.commands[sub].get_help(inner)


def on_files(files, config):
    """Add commands.md: a section for each group and command."""
    lines = ["# Commands", "", "What `skinbus COMMAND --help` prints."]
    for title, names in GROUPS.items():
        lines += ["", f"## {title}"]
        for name in names:
            for full in (name, *(f"{name} {sub}" for sub in SUBCOMMANDS.get(name, ()))):
                for heading, text in _help(full):
                    lines += ["", f"### skinbus {heading}", "", "```text", text, "```"]
    files.append(File.generated(config, "commands.md", content="\n".join(lines) + "\n"))
    return files
