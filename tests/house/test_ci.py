"""What the README tells a newcomer to type is what the CI runs."""

import os
import re
import subprocess
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
TEST_COMMAND = 'python -m pip install -e ".[test]" && python -m pytest'


def test_the_second_code_block_of_the_readme_installs_and_tests():
    blocks = re.findall(
        r"^```\w*\n(.*?)^```", (REPOSITORY / "README.md").read_text(encoding="utf-8"), re.M | re.S
    )
    assert blocks[1].strip() == TEST_COMMAND


def test_the_ci_takes_its_command_from_there():
    script = REPOSITORY / ".ci" / "run"
    assert os.access(script, os.X_OK)
    shown = subprocess.run(
        ["bash", script, "--show"], capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    assert shown.stdout.strip() == TEST_COMMAND, shown.stderr


def test_the_files_that_are_scheduled_by_name_are_there(request):
    """A file that is renamed is named anew in conftest.py, too."""
    (conftest,) = (p for p in request.config.pluginmanager.get_plugins() if hasattr(p, "TOGETHER"))
    for file in {*conftest.LONG, *(file for files in conftest.TOGETHER for file in files)}:
        assert (REPOSITORY / file).is_file(), file
    for place in conftest.COMPILED_PLAINLY:
        assert (REPOSITORY / place).exists(), place
