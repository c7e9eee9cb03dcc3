"""The network in the law's units, told its limits: one for every arm and every pan, level or lifting."""
