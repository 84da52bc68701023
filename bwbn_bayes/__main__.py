"""``python -m bwbn_bayes``: the command line where its script is not on the path."""

from bwbn_bayes.cli import main

if __name__ == "__main__":
    main()
