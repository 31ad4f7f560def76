"""What Python adds to a prediction."""

import json
import subprocess

from conftest import PROGRAMS, REPOSITORY


def test_a_whole_field_takes_at_most_a_fifth_longer_than_in_rust():
    """Both in turn, the smallest medians compared: other programs disturb single rounds."""
    command = [PROGRAMS / "softtwin-studies", "measure", "model", "--rounds", "3", "--at-least", "0.9", "--at-most", "1.2"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout)["result"]["ratio"] > 0.9, "Python cannot be faster than the library it calls"
