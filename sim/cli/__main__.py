"""`python -m sim.cli`: the command `pilsim` where no script is installed."""

from pilsim import main

if __name__ == "__main__":
    main()
