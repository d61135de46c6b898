"""``python -m skinbus`` is the command line."""

from skinbus.cli import main

main()
