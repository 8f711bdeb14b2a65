"""The tables of docs/tolerance.md keep the rows that are not measured again."""

from benchmarks.documents import replace_table, table_of
from benchmarks.tolerance import HEADER, with_row

ROWS = [
    "| winding | radius, white | **18** | 18 | optimal | 18 | 115 | 23 | 48 |",
    "| winding | covariance, persistent | **14** | 14 | optimal | 14 | 115 | 19 | 55 |",
    "| Norisring | radius, white | **44** | 31 | time_limit | 44 | – | 76 | 230 |",
]


def test_a_row_measured_again_takes_its_own_place() -> None:
    text = f"a\n<!-- table: x -->\n{HEADER}" + "\n".join(ROWS) + "\n<!-- end -->\nb"
    lines = table_of(text, "x").splitlines()
    assert lines[2:] == ROWS
    again = ROWS[2].replace("31", "44")
    assert with_row(lines, again) == [*ROWS[:2], again]
    new = ROWS[1].replace("winding", "Norisring")
    assert with_row(lines, new) == [*ROWS, new]
    assert with_row([], new) == [new]
    replaced = replace_table(text, "x", HEADER + "\n".join(with_row(lines, new)))
    assert table_of(replaced, "x").splitlines()[2:] == [*ROWS, new]
