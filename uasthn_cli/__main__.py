"""Run the command line as ``python -m uasthn_cli``."""

from uasthn_cli.commands.main import main

if __name__ == "__main__":
    main(prog_name="uasthn")
