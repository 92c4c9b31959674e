"""Makes `python -m trilink` run the command `trilink`."""

import sys

from trilink import _main

sys.exit(_main())
