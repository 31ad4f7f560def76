"""Files that come with the package, here those of the checkout; scripts/check.sh install finds those of the wheel."""

import pytest
import softtwin
from conftest import REPOSITORY


def test_files_of_the_checkout_are_found(monkeypatch):
    assert softtwin.shared_file("models/pneunet/pneunet.twin") == REPOSITORY / "models/pneunet/pneunet.twin"
    monkeypatch.setenv("SOFTTWIN_SHARE", str(REPOSITORY / "docs"))
    with pytest.raises(softtwin.SofttwinError, match="SOFTTWIN_SHARE"):
        softtwin.shared_file("models/pneunet/pneunet.twin")
