"""``python -m hbgear``: the same as the command ``hbgear``."""

from hbgear.cli.app import main

if __name__ == "__main__":
    main()
