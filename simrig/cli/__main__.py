"""``python -m simrig.cli`` is the ``simrig`` command."""

from simrig.cli import main

main()
