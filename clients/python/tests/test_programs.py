"""Files of the built wheel only; scripts/check.sh install tests the wheel."""

import pytest
import softtwin
from softtwin.programs import carried


def test_installation_of_the_sources_carries_no_programs():
    with pytest.raises(softtwin.SofttwinError, match="scripts/package.sh wheel"):
        carried("bin/softtwind")
