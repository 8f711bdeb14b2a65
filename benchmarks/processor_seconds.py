"""Run a benchmark with its limits in processor seconds: `python -m benchmarks.processor_seconds`.

After it come the module and its own options. A time limit is a clock's, and on a machine that other
work shares, a method given sixty seconds gets thirty. Here every limit, and every second a table
reports, is of this process's own processor time, so that a table measured on a busy machine says
what a quiet one would. Further processes are not counted; HiGHS keeps its own clock and stops
earlier than it need, which leaves its bounds valid and at most looser.
"""

from __future__ import annotations

import runpy
import sys
import time
from unittest.mock import patch


def main() -> None:
    """Run the module named first with the arguments after it."""
    if len(sys.argv) < 2:
        raise SystemExit("wanted the name of a module, as in benchmarks.entropy_bounds")
    module = sys.argv[1]
    sys.argv = sys.argv[1:]
    with patch.object(time, "monotonic", time.process_time):
        runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
