"""Parts of the data engine by name."""

from dataclasses import fields

import pytest

from uasthn_cli.training.engine import PARTS, EngineConfig, engine_without


def test_all_parts_are_on_unless_said_otherwise() -> None:
    assert engine_without(()) == EngineConfig()
    assert EngineConfig().missing == ()
    assert all(getattr(EngineConfig(), field.name) is True for field in fields(EngineConfig))


@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_switched_off_alone(part: str) -> None:
    engine = engine_without((part,))
    assert engine.missing == (part,)
    off = [field.name for field in fields(EngineConfig) if not getattr(engine, field.name)]
    assert off == [part.replace("-", "_")]
