"""The command line: parse, call, print. Every command is a function that returns a ``Report``."""


def main() -> None:
    """Run the command line (the ``simrig`` entry point)."""
    from simrig.cli.app import app

    app()
