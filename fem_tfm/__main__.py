# SPDX-License-Identifier: LGPL-3.0-or-later
"""`python -m fem_tfm` is the command `fem-tfm`."""

import sys

from fem_tfm.cli import main

if __name__ == "__main__":
    sys.exit(main())
