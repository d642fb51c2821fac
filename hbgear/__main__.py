"""The command ``hbgear``, also ``python -m hbgear``. Ctrl-C is reported in one sentence from the first import on."""

import sys

_EXIT_CODE_CTRL_C = 130  # the convention of shells: 128 + SIGINT


def main() -> None:
    """Import the command, run it and exit."""
    try:
        from hbgear.cli import startup

        startup.begin()
        from hbgear.cli.app import main as run

        run()
    except KeyboardInterrupt:
        print("hbgear: error: stopped before it was done", file=sys.stderr)
        sys.exit(_EXIT_CODE_CTRL_C)


if __name__ == "__main__":
    main()
