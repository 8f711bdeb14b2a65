"""Run a benchmark with its limits in processor seconds: `python -m benchmarks.processor_seconds`.

After it come the module and its own options. A time limit is a clock's, and on a machine that other
work shares, a method given sixty seconds gets thirty. Here every limit, and every second a table
reports, is of this process's own processor time, so that a table measured on a busy machine says
what a quiet one would. Further processes are not counted; HiGHS keeps its own clock and stops
earlier than it need, which leaves its bounds valid and at most looser.
"""

from __future__ import annotations

import argparse
import runpy
import sys
import time
from unittest.mock import patch


def main() -> None:
    """Run the module named first with the arguments after it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("module", help="the name of a module, as in benchmarks.entropy_bounds")
    parser.add_argument("options", nargs=argparse.REMAINDER, help="what that module is given")
    given = parser.parse_args()
    sys.argv = [given.module, *given.options]
    with patch.object(time, "monotonic", time.process_time):
        runpy.run_module(given.module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
