"""Many commands: read in their order, cut into shards, planned by any number of processes, each shard written whole."""
