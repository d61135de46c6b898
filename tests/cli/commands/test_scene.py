"""`skinbus scene`: its lists, its verdict on a file, its prices."""

from tests.cli.invoke import run
from tests.files import put


def test_list_of_names_explains_their_parameters():
    said = run("scene", "list", "noise", "elastic")
    for word in ("sigma_pa", "200 Pa", "standard deviation", "poisson"):
        assert word in said
    assert "did you mean 'noise'?" in run("scene", "list", "nois", status=2)


def test_check_says_that_a_file_is_right(tmp_path):
    assert "no faults" in run(
        "scene", "check", put(tmp_path, "mine.toml", '[scene]\narm = "pad"\nduration_s = 1\n[effect.noise]\n')
    )
