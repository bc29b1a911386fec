"""Write the JSON Schema of case files to standard output: ``python -m rsgen.cases``."""

import json
import sys

from rsgen.cases import case_schema

json.dump(case_schema(), sys.stdout, indent=2)
sys.stdout.write("\n")
