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
    finally:
        # CPython remembers an interrupt within the exec of a text, as in a dataclass, and ends `python -m` by SIGINT
        # instead of with its exit code; the next exec resets this
        exec("")


if __name__ == "__main__":
    main()
