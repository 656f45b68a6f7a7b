"""The flight that the tests of the pipeline share."""

import pytest
from posed_flight import PosedFlight, make_posed_flight


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> PosedFlight:
    """Return a flight whose frames are seen at an angle."""
    return make_posed_flight(tmp_path_factory.mktemp("posed"))
