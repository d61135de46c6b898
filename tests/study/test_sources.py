"""Figures and tables of the docs were made by the code that is here."""

from pathlib import Path

import pytest

from skinbus.study import sources
from skinbus.study.sources import code_stamp, outdated, write_stamp

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("folder", [DOCS, DOCS / "figures"], ids=lambda folder: folder.name)
def test_every_figure_and_table_of_the_docs_was_made_by_this_code(folder):
    assert outdated(folder) == []


def module(folder, monkeypatch, text):
    """A stamp of a module with this text."""
    name = f"made_{abs(hash(text))}"
    (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(folder))
    return code_stamp([name])


CODE = '"""Of one."""\n\nA = 1\n"""A unit."""\n'


@pytest.mark.parametrize("change", ["A = 1  # why\n", '"""Of another."""\n\nA = 1\n', "\n\nA = 1\n"])
def test_words_and_layout_change_no_stamp(tmp_path, monkeypatch, change):
    assert module(tmp_path, monkeypatch, CODE) == module(tmp_path, monkeypatch, change)


def test_other_code_has_another_stamp(tmp_path, monkeypatch):
    assert module(tmp_path, monkeypatch, CODE) != module(
        tmp_path, monkeypatch, CODE.replace("A = 1", "A = 2")
    )


def test_code_that_is_imported_counts(tmp_path, monkeypatch):
    plain = module(tmp_path, monkeypatch, "A = 1\n")
    assert plain != module(tmp_path, monkeypatch, "A = 1\nfrom skinbus.model import law\n")


def test_what_other_code_has_made_is_named_with_the_command_that_makes_it_anew(tmp_path, monkeypatch):
    write_stamp(tmp_path, "a.csv", "make a", ["skinbus.study.score"])
    assert outdated(tmp_path) == []
    monkeypatch.setattr(sources, "UNRELATED", ("model",))
    assert outdated(tmp_path) == [f"{tmp_path / 'a.csv'} was made by other code: `make a` makes it anew"]
