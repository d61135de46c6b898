"""Files that tests write, and why they are refused."""

import pytest

from skinbus.errors import ConfigError


def put(folder, name, text):
    """Write a file; return its path."""
    path = folder / name
    path.write_text(text)
    return path


def faults_of(read, *given):
    """Return the faults for which a reader refuses what it is given."""
    with pytest.raises(ConfigError) as caught:
        read(*given)
    return [str(fault) for fault in caught.value.faults]
