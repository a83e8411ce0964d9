"""Write the commit of this checkout for `ergon --version` of a wheel that is built from it.

python -m docs.generators.build_record ergon/api/build.json
"""

import json
import sys
from pathlib import Path

from ergon.common.commit import commit_of

if __name__ == "__main__":
    text = json.dumps({"commit": commit_of(Path(__file__).resolve().parents[2])})
    Path(sys.argv[1]).write_text(text + "\n", encoding="utf-8")
