"""How sections are measured, judged and printed."""
