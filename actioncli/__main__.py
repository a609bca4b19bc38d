"""Entry point of the `actioncli` command and of `python -m actioncli`."""

import os
import sys


def main() -> None:
    """Run the command line; ends the process with one of the exit codes of `--help`."""
    # A query's matrices are so small that a second thread of numpy waits longer than it works:
    # with two threads, `classify` takes twice the processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from actioncli.cli.app import app

        app(prog_name="actioncli")
    except KeyboardInterrupt:
        # Ctrl-C while imports still run, or options are put together: before the application can
        # answer it.
        sys.exit(130)


if __name__ == "__main__":
    main()
