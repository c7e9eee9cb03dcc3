"""`python -m benchmarks`: the same as `slide-bench`."""

from benchmarks.cli import bench_main

if __name__ == "__main__":
    bench_main()
