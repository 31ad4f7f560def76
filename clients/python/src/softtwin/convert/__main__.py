"""`python -m softtwin.convert`."""

import sys

from . import main

sys.exit(main())
