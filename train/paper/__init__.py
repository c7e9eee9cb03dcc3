"""The paper's own network, trained as the paper says: for its reproduction. Nothing plans with it."""
