"""Tables in the terminal."""

from ergon.cli.tables import table


def test_table_column_widths_and_alignment():
    rows = [("part", "cost"), ("a bell", "1"), ("b", "")]
    assert table(rows) == "part    cost\na bell  1\nb\n"
    assert table(rows, right=True) == "  part  cost\na bell     1\n     b\n"
