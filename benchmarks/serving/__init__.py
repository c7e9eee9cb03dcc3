"""`slide-serve` as it is measured: started, used, attacked, and watched."""
