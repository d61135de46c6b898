"""What goes in and out of a command: the console, files for programs, and errors of files as one line."""

from __future__ import annotations

import errno
import json
import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any, Final

import click

from skinbus import __version__
from skinbus.errors import SkinbusError
from skinbus.printable import layout

BROKEN_PIPE: Final = 141
"""Status when the reader of our output has gone: what a shell makes of a SIGPIPE."""


STREAMS: Final = ("/dev/", "/proc/self/fd/")
"""Where links stand for what is open."""

INPUTS: Final = (".toml", ".eds", ".dcf", ".log")
"""How files are called that commands read."""


def echo(text: object, *, err: bool = False, nl: bool = True) -> None:
    """Print text to standard output or standard error, without control characters but line feeds."""
    click.echo(layout(text), err=err, nl=nl)


@contextmanager
def printable_errors() -> Iterator[None]:
    """Escape what click will say of words it was given."""
    try:
        yield
    except click.ClickException as error:
        vars(error)["message"] = layout(error.message)
        raise


class PrintableLog(logging.Formatter):
    """Records of libraries, which may quote what came from a bus."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record as text without control characters but line feeds."""
        return layout(super().format(record))


def file_error(error: OSError | UnicodeDecodeError) -> str:
    """Return an error of the system as text: which file, and what is wrong with it."""
    if isinstance(error, UnicodeDecodeError):
        return f"a file is not text: {error}"
    what = error.strerror or str(error) or type(error).__name__
    return f"{error.filename}: {what}" if error.filename else what


def forget_output() -> None:
    """Let what cannot be written go to nowhere, so that the interpreter's end does not complain."""
    with suppress(OSError, ValueError):  # no real file: a test's
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def is_broken_pipe(error: BaseException | None) -> bool:
    """Whether the reader of our output has gone."""
    return isinstance(error, OSError) and error.errno == errno.EPIPE


SUMMARY: Final = '{\n "skinbus": '
"""How a summary begins."""


def keep_others(path: str | os.PathLike[str], begins: str, what: str) -> None:
    """Refuse a file that is there and does not begin as ours; an empty one holds nothing."""
    if os.path.isfile(path):
        with open(path, "rb") as file:
            head = file.read(len(begins))
        if head and head != begins.encode():
            raise click.BadParameter(
                f"{path} is there already and is no {what} of skinbus: remove it, or give another name"
            )


def state(ctx: click.Context, parameter: click.Parameter, value: Path | None) -> Path | None:
    """Refuse a state that would take the place of a file of anybody else."""
    from skinbus.config.state_file import MAGIC

    if value is not None:
        try_to_write(value)
        for ending in ("", ".1", ".health", ".health.1"):
            keep_others(f"{value}{ending}", MAGIC, "state")
    return value


def json_file(
    ctx: click.Context, parameter: click.Parameter, value: str | None
) -> Callable[[Any], None] | None:
    """Return what writes the summary; what could not be written at the end is refused at the beginning."""
    stdout = sys.stdout
    if value is None:
        return None
    if value == "-":  # nothing else may be on it
        ctx.with_resource(redirect_stdout(sys.stderr))
    else:
        try_to_write(value)
        keep_others(value, SUMMARY, "summary")

    def write(summary: Any) -> None:
        text = json.dumps({"skinbus": __version__, **summary}, indent=1) + "\n"
        if value == "-":
            stdout.write(text)
            stdout.flush()
        else:
            Path(value).write_text(text, encoding="utf-8")

    return write


def try_to_write(path: str | os.PathLike[str], *kinds: str) -> None:
    """Refuse a file that cannot be written, that stands for another one, or that would be lost.

    Args:
        path: is left as it is.
        kinds: endings of files that commands read, but that this one writes anew.
    """
    is_new = not os.path.lexists(path)
    if os.path.islink(path) and not os.fspath(path).startswith(STREAMS):
        raise click.BadParameter(f"{path} is a symbolic link; give the file that is to be written")
    ending = os.path.splitext(path)[1].lower()
    if not is_new and ending in INPUTS and ending not in kinds:
        raise click.BadParameter(
            f"{path} is there already; it would be lost: remove it, or give another name"
        )
    try:
        with open(path, "ab"):
            pass
    except OSError as error:
        raise click.BadParameter(f"cannot write {file_error(error)}") from error
    if is_new:
        os.unlink(path)


def keep_files(names: Iterable[Path], arm: str, files: Iterable[Path]) -> None:
    """Refuse to write over one of the files that are read with an arm."""
    read = {name.resolve() for name in names} & set(files)
    if read:
        raise click.BadParameter(f"{min(read).name} is read with {arm} and would be lost: give another name")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield where to write a file, which takes its place when it is whole."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def figures_wanted() -> Iterator[None]:
    """Turn a missing matplotlib into one clear message."""
    try:
        yield
    except ImportError as error:
        raise SkinbusError(f"figures need matplotlib ({error}); pip install 'skinbus[figures]'") from error


def folder(ctx: click.Context, parameter: click.Parameter, value: Path | None) -> Path | None:
    """Make a folder before the work begins, or refuse it."""
    if value is not None:
        try:
            value.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise click.BadParameter(f"cannot make {file_error(error)}") from error
    return value


def _of_kind(what: str, *kinds: str) -> Callable[..., Path | None]:
    """Return what refuses a file of another kind, or one that cannot be written."""

    def check(ctx: click.Context, parameter: click.Parameter, value: Path | None) -> Path | None:
        if value is not None:
            if kinds and value.suffix.lower() not in kinds:
                raise click.BadParameter(f"{value}: a {what} ends with {kinds[0]}")
            try_to_write(value, *kinds)
        return value

    return check


writable = _of_kind("file")
dcf = _of_kind("DCF", ".dcf")
svg = _of_kind("figure", ".svg")
