"""The command ``hbgear``, also ``python -m hbgear``. Ctrl-C gives one sentence from its first import on."""

import sys

_CTRL_C = 130  # exit code of what Ctrl-C ended, as shells have it


def main() -> None:
    """Import what the command is made of, run it and exit."""
    try:
        from hbgear.common import command

        command.begin()
        from hbgear.cli.app import main as run

        run()
    except KeyboardInterrupt:
        print("hbgear: error: stopped before it was done", file=sys.stderr)
        sys.exit(_CTRL_C)


if __name__ == "__main__":
    main()
