"""What the driver's library gives becomes ours: packets of the library's own types, and its own configurations."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from core.devices.models import EVK4, MODELS, read_biases, write_biases
from core.devices.neuromorphic import DriverCamera, load_driver, open_camera
from core.errors import ConfigError, DeviceError
from core.events import Events, SensorSize
from tests.core.devices.replayed_hardware import DTYPE, Replayed, ReplayedLibrary

nd = load_driver()
TIME_OF_DAY_S, CLOCK_S = 1.7e9, 5000.0
"""What the two clocks of this machine show: the one that may be set, and the monotonic one."""


class Nothing:
    sensor = SensorSize(1280, 720)

    def slice(self, start_us: int, end_us: int) -> Events:
        return Events.empty(self.sensor)


class Scripted:
    """The library's open camera, as far as it is read: it says what it was told to say."""

    def __init__(self, *said) -> None:
        self._said = list(said)

    def biases_bounds(self):
        names = nd.prophesee_evk4.BiasesBounds.__dataclass_fields__
        return nd.prophesee_evk4.BiasesBounds(**{name: nd.prophesee_evk4.Bounds(-50, 100) for name in names})

    def __next__(self):
        return self._said.pop(0)


def packet(*t_us: int, overflow: bool = False):
    found = nd.packet.Evt3Packet()
    found.polarity_events = np.array([(t, 5, 6, True) for t in t_us], DTYPE) if t_us else None
    found.trigger_events = None
    found.polarity_events_overflow_indices = np.array([0]) if overflow else None
    found.trigger_events_overflow_indices = None
    return found


def status(current_t: int, raw_packets: int = 1, *, ago_s: float = 0.0, dropped: int = 0):
    ring = nd.status.RingStatus(TIME_OF_DAY_S - ago_s, 0, raw_packets, False, current_t, dropped)
    return nd.status.Status(TIME_OF_DAY_S, ring)


def camera_of(*said) -> DriverCamera:
    return DriverCamera(Scripted(*said), EVK4, "1", nd.prophesee_evk4.Configuration())


def test_a_packet_has_its_times_on_the_monotonic_clock(monkeypatch):
    monkeypatch.setattr("core.devices.neuromorphic.time", SimpleNamespace(monotonic=lambda: CLOCK_S))
    camera = camera_of((status(1000, ago_s=0.25), packet(900, 950)), (status(2000), packet()))
    found = camera.read()
    assert found is not None and found.host_s == pytest.approx(CLOCK_S - 0.25, abs=1e-5)
    assert found.stamp_us == found.complete_us == 1000 and found.events["t"].tolist() == [900, 950] and not found.gap
    quiet = camera.read()
    assert quiet is not None and quiet.events is None and quiet.complete_us == 2000


def test_of_merged_packets_no_time_is_believed_that_had_not_come_yet():
    camera = camera_of((status(9000, 40), packet(900, 8950)), (status(20_000, 64), packet()))
    first, second = camera.read(), camera.read()
    assert first is not None and first.stamp_us == 900 and first.complete_us == 9000
    assert second is not None and second.stamp_us == 9000 and second.complete_us == 20_000


def test_that_nothing_came_is_no_packet_and_what_was_dropped_is_told():
    nothing = nd.status.Status(TIME_OF_DAY_S, None)
    camera = camera_of(
        (nothing, None), (status(10, dropped=3), packet(5, overflow=True)), (status(20, dropped=3), packet())
    )
    assert camera.read() is None
    lost, after = camera.read(), camera.read()
    assert lost is not None and lost.gap and lost.packets_dropped == 3
    assert after is not None and not after.gap


def test_raw_packets_say_where_something_is_missing():
    ring = nd.status.RawRingStatus(TIME_OF_DAY_S, 0, 2, False, [64], 1)
    found = camera_of((nd.status.RawStatus(TIME_OF_DAY_S, ring), b"\x00" * 128)).read_raw()
    assert found is not None and found.gaps == (64,) and found.packets_dropped == 1 and not found.alone


def test_biases_are_bounded_by_what_the_camera_allows():
    bounds = {bias.name: (bias.low, bias.high) for bias in camera_of().biases}
    assert bounds["diff_on"] == (-50, 100) and bounds["fo"] == (-35, 55) and bounds["hpf"] == (0, 100)


def test_biases_reach_the_camera_all_or_none():
    library = ReplayedLibrary({"8": Replayed(stream=Nothing(), duration_us=1)})
    camera = open_camera("8", biases={EVK4.name: {"diff_on": 20}}, driver=library)
    device = library.opened[0]
    assert device.configuration.biases.diff_on == 20 and camera.bias_values()["diff_on"] == 20
    camera.set_biases({"fo": -10, "hpf": 7})
    assert (device.configuration.biases.fo, device.configuration.biases.hpf) == (-10, 7)
    for wrong in ({"fo": 3, "hpf": 999}, {"fo": 3, "colour": 1}, {"fo": 1.5}):
        with pytest.raises(ConfigError):
            camera.set_biases(wrong)
        assert camera.bias_values()["fo"] == -10


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.module)
def test_every_model_is_one_of_the_librarys_with_its_biases_size_and_clock(model):
    module = getattr(nd, model.module)
    biases = module.Configuration().biases
    assert (module.Properties().width, module.Properties().height) == (model.sensor.width_px, model.sensor.height_px)
    assert hasattr(module, "Clock") == model.cable and model.name in {name.value for name in nd.Name}
    for bias in model.biases:
        assert getattr(biases, bias.name) == bias.default and bias.low <= bias.default <= bias.high and bias.doc
        for value in (bias.low, bias.high):
            setattr(biases, bias.name, value)
            biases.serialize()


def test_a_library_that_cannot_ask_usb_says_so_in_one_line():
    class Broken:
        def list_devices(self):
            raise RuntimeError("Other error")

    with pytest.raises(DeviceError, match=r"the cameras cannot be listed.*Other error"):
        open_camera("1", driver=Broken())


def test_biases_are_kept_in_a_file(tmp_path):
    sets = {EVK4.name: {"diff_on": 12, "fo": -3}}
    write_biases(tmp_path / "biases.toml", sets)
    assert read_biases(tmp_path / "biases.toml") == sets


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("x =", "not a TOML file"),
        ("[Nobody]\na = 1", "no such model of camera"),
        ('["Prophesee EVK4"]\ncolour = 1', "no such bias"),
        ('["Prophesee EVK4"]\nfo = 900', "bias fo out of bounds.*-35 to 55"),
        ('["Prophesee EVK4"]\nfo = true', "bias fo out of bounds"),
    ],
)
def test_a_file_of_other_things_is_refused(tmp_path, text, line):
    path = tmp_path / "biases.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=line):
        read_biases(path)
