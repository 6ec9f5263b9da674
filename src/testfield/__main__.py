"""`python -m testfield` is the command `testfield`."""

import sys

from testfield.cli.main import main

sys.exit(main())
