"""`skinbus scene`: its lists, its verdict on a file, its prices."""

from tests.cli.invoke import refused, run


def test_list_of_names_explains_their_parameters():
    said = run("scene", "list", "noise", "elastic")
    for word in ("sigma_pa", "200 Pa", "standard deviation", "poisson"):
        assert word in said
    run("scene", "list", "nois", status=2)


def test_check_says_that_a_file_is_right(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[scene]\narm = "pad"\nduration_s = 1\n[effect.noise]\n')
    assert "no faults" in run("scene", "check", path)


def test_bad_scene_is_one_message_with_every_fault(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('[scene]\narm = "pad"\nduration_s = -1\n[effect.nois]\n[effect.loss]\nprobability = 2\n')
    said = refused("scene", "check", path)
    assert "3 faults" in said
    for key in ("scene.duration_s", "effect.nois", "effect.loss.probability"):
        assert key in said
