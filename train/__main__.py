"""`python -m train` is `slide-train`; torchrun starts it as `torchrun --nproc-per-node N -m train CONFIG -o DIR`.

torchrun reads `--run` as one of its own options, also behind the module's name; `-o` is the same and passes.
"""

from train.cli import train_main

if __name__ == "__main__":
    train_main()
