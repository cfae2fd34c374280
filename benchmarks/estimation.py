"""`python -m benchmarks.estimation`: everything about estimation, the same as

python -m benchmarks estimation_study estimation_refit estimation_plants
"""

import sys

from benchmarks.__main__ import main

if __name__ == "__main__":
    sys.argv[1:1] = ["estimation_study", "estimation_refit", "estimation_plants"]
    sys.exit(main())
