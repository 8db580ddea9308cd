"""`python -m tests.corpus`: see `run.py`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from corpus.run import main

sys.exit(main())
