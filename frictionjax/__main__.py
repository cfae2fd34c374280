"""`python -m frictionjax`: the same program as the `frictionjax` command."""

import sys

from frictionjax.cli import main

sys.exit(main())
