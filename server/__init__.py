"""The planner over HTTP: `POST /plan`, `POST /plans`, `WS /stream`, and a page to draw on."""
