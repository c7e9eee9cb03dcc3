"""How sections are measured, judged and printed; `benchmarks.harness.section` says what a section is."""
