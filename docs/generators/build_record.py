"""Write the commit of this checkout for `ergon --version` of a wheel that is built from it.

python -m docs.generators.build_record ergon/api/build.json
"""

import json
from pathlib import Path

from ergon.common.commit import commit_of
from ergon.common.module_arguments import module_arguments

if __name__ == "__main__":
    text = json.dumps({"commit": commit_of(Path(__file__).resolve().parents[2])})
    Path(module_arguments("FILE")[0]).write_text(text + "\n", encoding="utf-8")
