"""The doors: HTTP, WebSocket and what they take."""
