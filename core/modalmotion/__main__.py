"""``python -m modalmotion`` is the command line."""

from modalmotion.cli import main

if __name__ == "__main__":
    main(prog_name="modalmotion")
