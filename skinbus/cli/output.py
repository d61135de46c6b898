"""What goes in and out of a command: the console, files for programs, and errors of files as one line."""

from __future__ import annotations

import errno
import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import click

from skinbus.printable import layout

BROKEN_PIPE = 141
"""Status when the reader of our output has gone: what a shell makes of a SIGPIPE."""


STREAMS = ("/dev/", "/proc/self/fd/")
"""Where links stand for what is open."""

INPUTS = (".toml", ".eds", ".dcf", ".log")
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


def state(ctx: click.Context, parameter: click.Parameter, value: Path | None) -> Path | None:
    """Refuse a state that would take the place of a file of anybody else; an empty one holds nothing."""
    from skinbus.config.state_file import MAGIC

    if value is not None:
        try_to_write(value)
        for file in (Path(f"{value}{ending}") for ending in ("", ".1", ".health", ".health.1")):
            if not file.is_file():
                continue
            with file.open("rb") as content:
                head = content.read(len(MAGIC))
            if head not in (b"", MAGIC.encode()):
                raise click.BadParameter(
                    f"{file} is there already and is no state of skinbus: remove it, or give another name"
                )
    return value


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
