"""`python -m srvgen` is the `srvgen` command."""

import sys

from .cli import main

sys.exit(main())
