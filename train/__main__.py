"""`python -m train` is `slide-train`; torchrun starts it as `torchrun --nproc-per-node N -m train CONFIG`."""

from train.cli import train_main

if __name__ == "__main__":
    train_main()
