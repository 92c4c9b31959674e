"""`python -m trilink` is the command `trilink`."""

import sys

from trilink import _main

sys.exit(_main())
