"""Tables are written where a page has a place for them."""

from __future__ import annotations

import pytest

from benchmarks.harness.markdown import markdown, write_into
from benchmarks.harness.tables import table
from runtime.errors import InputError

PAGE = "# Results\n\n<!-- slide-bench: peers -->\nwhat was there\n<!-- end -->\n\nThe rest.\n<!-- end -->\n"
TABLE = table("RMSE (mm)", ("planner", "mean"), [("network", "1.00"), ("  CEM \\1", "2.00")])


def test_a_table_is_markdown() -> None:
    assert markdown(TABLE).splitlines() == [
        "**RMSE (mm)**",
        "",
        "| planner | mean |",
        "| --- | ---: |",
        "| network | 1.00 |",
        "| &nbsp;&nbsp;CEM \\1 | 2.00 |",
    ]


def test_bars_are_not_those_of_the_table() -> None:
    assert markdown(table("u", ("", "|du|"), [("a", "1")])).splitlines()[2] == "|  | \\|du\\| |"


def test_what_was_aimed_at_is_left_out() -> None:
    judged = table("Speed", ("", "measured", "target", "met"), [("a plan (ms)", "3.0", "<= 4.0", "yes")])
    assert markdown(judged).splitlines()[2:] == ["|  | measured |", "| --- | ---: |", "| a plan (ms) | 3.0 |"]
    judged = table("Arms", ("arm", "hold"), [("fr3", "13"), ("asked for", "all")])
    assert markdown(judged).splitlines()[2:] == ["| arm | hold |", "| --- | ---: |", "| fr3 | 13 |"]


def test_tables_stand_in_the_place_of_what_was_there() -> None:
    page = write_into(PAGE, "page.md", {"peers": [TABLE]})
    assert "what was there" not in page
    assert page.startswith("# Results\n\n<!-- slide-bench: peers -->\n\n**RMSE (mm)**\n\n| planner")
    assert page.endswith("| &nbsp;&nbsp;CEM \\1 | 2.00 |\n\n<!-- end -->\n\nThe rest.\n<!-- end -->\n")
    assert write_into(page, "page.md", {"peers": [TABLE]}) == page


def test_a_page_without_a_place_is_refused() -> None:
    with pytest.raises(InputError, match=r"page\.md has no place for best: <!-- slide-bench: best -->"):
        write_into(PAGE, "page.md", {"best": []})
