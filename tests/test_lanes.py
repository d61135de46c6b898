"""The quick lane has a test of every file, and of no function more than it may cost."""

from tests.lanes import LONG_S, SECONDS, in_order, quick, read_table


def test_cases_of_a_function_are_taken_until_its_time_is_used_up():
    cases = [(f"a.py::f[{k}]", False) for k in range(5)] + [("a.py::g", False)]
    assert quick(cases, {"a.py::f": SECONDS / 2.5}) == [True, True, False, False, False, True]


def test_what_is_marked_slow_is_left_out():
    assert quick([("a.py::f", True), ("a.py::g", False)], {}) == [False, True]


def test_a_file_of_expensive_tests_keeps_the_cheapest():
    cases = [("a.py::f", False), ("a.py::g[0]", False), ("a.py::g[1]", False), ("a.py::h", True)]
    assert quick(cases, {"a.py::f": 9.0, "a.py::g": 4.0}) == [False, True, False, False]
    assert quick([("b.py::f", True)], {}) == [True]


def test_files_with_a_long_one_come_first_and_their_tests_stay_together():
    mean_s = {"b.py::h": LONG_S, "c.py::h": 2.0 * LONG_S, "d.py::f": 0.9 * LONG_S}
    names = ["a.py::f", "b.py::f", "b.py::h", "b.py::i", "c.py::f", "c.py::h[0]", "d.py::f"]
    assert in_order(names, mean_s) == [4, 5, 1, 2, 3, 0, 6]


def test_the_table_is_read_as_it_is_written(tmp_path):
    (tmp_path / "table.txt").write_text("1.25 tests/a.py::f\n0.80 tests/b.py::g\n")
    assert read_table(tmp_path / "table.txt") == {"tests/a.py::f": 1.25, "tests/b.py::g": 0.8}
    assert all(seconds >= 0.0 for seconds in read_table().values())
