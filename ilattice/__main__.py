"""``python -m ilattice``: the command line, where scripts are not on the path."""

from ilattice.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
