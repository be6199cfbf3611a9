"""The test of docs/own-tests.md passes as the page has it."""

import re
import shutil
import subprocess
import sys

from conftest import REPOSITORY


def test_the_test_of_the_page_passes(tmp_path, files):
    page = (REPOSITORY / "docs" / "own-tests.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "test_valve.py").write_text(program, encoding="utf-8")
    shutil.copy(files / "made-up-adapter.eds", tmp_path / "valve.eds")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_valve.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout
