"""Whole frames of a stream with moving objects: from asking for a frame to numpy arrays in hand.

The first frame of a line includes what that line compiles; lines after the first two should compile nothing.
"""

from tiscene.commands import bench, demo

SECONDS = 5.0


def main() -> None:
    """Print the table."""
    bench.print_table(demo.scenario(), seconds=SECONDS)


if __name__ == "__main__":
    main()
