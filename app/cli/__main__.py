"""`python -m app.cli` is `rallyscope`, for starting a verb as a process of its own."""

import sys

from app.cli.main import main

sys.exit(main())
