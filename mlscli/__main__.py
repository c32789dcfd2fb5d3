"""Run the command line as ``python -m mlscli``."""

from mlscli.cli import main

if __name__ == "__main__":
    main()
