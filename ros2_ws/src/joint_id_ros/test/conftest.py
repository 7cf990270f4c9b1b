"""A ROS domain of its own for each test that takes part in one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from ros_domain import own_domain


@pytest.fixture
def domain() -> Iterator[int]:
    """The test is on this domain, and so is every process that it starts."""
    with own_domain() as number:
        yield number
