"""What the commands of `tiscene` do, one file each, with `run(args)`. Their arguments are in tiscene/cli.py."""
