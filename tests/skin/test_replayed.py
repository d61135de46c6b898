"""A recording whose interface has to be said is refused in the words of Python."""

import pytest

import skinbus
from skinbus.errors import AddressError
from tests.files import put


def test_an_interface_that_is_not_in_the_log_is_refused(tmp_path):
    log = put(tmp_path, "two.log", "(1.0) can0 080#\n(1.0) can1 080#\n")
    with pytest.raises(AddressError, match=r"in Python\) which of them"):
        skinbus.replay(log, "pad")
