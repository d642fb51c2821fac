"""``python -m hbgear``: the same as the command ``hbgear``."""

from hbgear.cli import main

if __name__ == "__main__":
    main()
