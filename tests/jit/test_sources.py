"""A compiled kernel is out of date when something that it is made from has changed, and only then."""

from skinbus.jit.sources import sources_stamp
from tests.files import put


def write(folder, **sources):
    """A package of modules, one of them in a package of its own."""
    package = folder / "skinbus"
    (package / "deep").mkdir(parents=True, exist_ok=True)
    for name, text in sources.items():
        (package / (name.replace("__", "/") + ".py")).write_text(text)
    return package


KERNEL = "from skinbus.first import (\n    A,  # a constant\n    B,\n)\nfrom skinbus import deep\n"


def stamp(folder, **changes):
    sources = {
        "kernel": KERNEL, "first": "from skinbus.deep import second\nA = 1\n", "deep__second": "C = 1\n",
        "unused": "D = 1\n",
    }  # fmt: skip
    package = write(folder, **(sources | changes))
    put(package / "deep", "__init__.py", changes.get("init", ""))
    return sources_stamp(str(package / "kernel.py"), package)


def test_module_that_is_not_imported_does_not_matter(tmp_path):
    assert stamp(tmp_path / "a") == stamp(tmp_path / "b", unused="D = 2\n")


def test_each_source_in_the_chain_of_imports_matters(tmp_path):
    changes = {
        "kernel": KERNEL + "#",
        "first": "from skinbus.deep import second\nA = 2\n",
        "deep__second": "C = 2\n",
        "init": "E = 1\n",
    }
    stamps = [stamp(tmp_path / "0")]
    stamps += [stamp(tmp_path / name, **{name: text}) for name, text in changes.items()]
    assert len(set(stamps)) == len(stamps)
