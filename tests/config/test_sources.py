import random
import string
import tomllib

import pytest

from config.scenarios import scenario_names, scenario_path
from config.settings import Settings
from config.sources import ConfigError, load, load_settings, to_toml


@pytest.fixture
def write(tmp_path):
    def _write(text, name="field.toml"):
        file = tmp_path / name
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return file

    return _write


def refusal(files=(), overrides=(), environment=None):
    with pytest.raises(ConfigError) as caught:
        load(files, overrides, environment or {})
    return str(caught.value)


def test_nothing_given_is_the_defaults():
    loaded = load(environment={})
    assert loaded.settings == Settings()
    assert set(loaded.places.values()) == {"default"}


def test_the_command_line_wins_over_the_environment_over_files_over_defaults(write):
    first = write("[guard]\nmax_height_m = 110\nmax_wind_mps = 9\nmax_gust_mps = 13\n", "a.toml")
    second = write("[guard]\nmax_height_m = 120\nmax_wind_mps = 8\n", "b.toml")
    loaded = load(
        [first, second],
        ["guard.max_height_m=140"],
        {"BLADESCOUT_GUARD__MAX_HEIGHT_M": "130", "BLADESCOUT_GUARD__MAX_WIND_MPS": "7"},
    )
    guard = loaded.settings.guard
    assert (guard.max_height_m, guard.max_wind_mps, guard.max_gust_mps) == (140, 7, 13)
    assert loaded.places["guard.max_height_m"] == "--set"
    assert loaded.places["guard.max_wind_mps"] == "BLADESCOUT_GUARD__MAX_WIND_MPS"
    assert loaded.places["guard.max_gust_mps"] == str(first)
    assert loaded.places["guard.max_lead_m"] == "default"


def test_every_setting_has_a_place(write):
    file = write('[[sites]]\nname = "T1"\nturbine = "nrel-5mw"\n')
    leaves = {key: (value, place) for key, value, place in load([file], (), {}).leaves()}
    assert leaves["sites.0.turbine"] == ("nrel-5mw", str(file))
    assert leaves["sites.0.scale"] == (1.0, "default")
    assert leaves["simulation.truth.pitch_deg"] == ("random", "default")


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("vehicle=7", "vehicle", "7"),
        ("bus.listen=", "bus.listen", ""),
        ("simulation.speed=auto", "simulation.speed", "auto"),
        ("simulation.speed=2", "simulation.speed", 2.0),
        ("inspection.blades=A, C", "inspection.blades", ["A", "C"]),
        ('inspection.sides=["LE"]', "inspection.sides", ["LE"]),
        ("lidar.offset_m=0.1,0,0.2", "lidar.offset_m", [0.1, 0.0, 0.2]),
        ("simulation.weather.clouds=false", "simulation.weather.clouds", False),
        ('vehicle="crane"', "vehicle", "crane"),
        ("camera.stream_url=rtsp://u:p@h/?a=b", "camera.stream_url", "rtsp://u:p@h/?a=b"),
    ],
)
def test_a_text_is_read_as_what_the_key_takes(text, key, value):
    leaves = {name: found for name, found, _ in load([], [text], {}).leaves()}
    assert leaves[key] == value


def test_one_item_of_a_list_can_be_changed():
    settings = load_settings([scenario_path("demo")], ["sites.0.scale=0.5"], {})
    assert (settings.sites[0].scale, settings.sites[0].turbine) == (0.5, "windpact-1.5")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("guard.max_hight_m=1", "not a known setting: did you mean guard.max_height_m?"),
        ("guard.min_clearance_m=3", "= 3 is not allowed: it must be a finite number at least 5"),
        ("airframe.max_speed_mps=16", "a finite number above 0 and at most 15"),
        ("airframe.max_speed_mps=nan", "= nan is not allowed"),
        ("simulation.speed=fast", "above 0 and at most 20 or 'auto'"),
        ("inspection.sides=PS,UP", "sides.1 = 'UP' is not allowed: it must be one of 'PS', 'SS',"),
        ("guard=3", "guard = 3 is not allowed: it must be a table with min_clearance_m"),
        ("vehicle=a b", "it must be 1 to 32 letters, digits, '_' and '-'"),
        ("autopilot.system_id=1.5", "a whole number at least 1 and at most 255"),
        ("guard", "write it as section.key=value"),
        ("=3", "write it as section.key=value"),
        ("vehicle.name=x", "vehicle"),
        ("sites.3.name=x", "no such item"),
        ("simulation.faults.0.device=lidar", "simulation.faults.0.word is missing"),
    ],
)  # fmt: skip
def test_a_bad_option_names_place_key_value_and_range(text, words):
    said = refusal(overrides=[text])
    assert said.startswith("--set")
    assert words in said


def test_a_bad_variable_is_named():
    said = refusal(environment={"BLADESCOUT_TRACKING__DISTANCE_M": "5"})
    assert said == (
        "BLADESCOUT_TRACKING__DISTANCE_M: tracking.distance_m = 5 is not allowed: "
        "it must be a finite number at least 10 and at most 20"
    )


def test_every_mistake_of_a_file_is_listed_with_its_file(write):
    file = write("[guard]\nmax_lead_m = 9\n[tracking]\noverlap = 2\nspeed = 1\n")
    problems = refusal([file]).splitlines()
    assert len(problems) == 3
    assert all(problem.startswith(f"{file}: ") for problem in problems)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xff\xfe[guard]", "not UTF-8 text (byte 1)"),
        (b"[guard]\nmax_lead_m = \n", "not valid TOML: Invalid value (at line 2"),
        (b"x = " + b"[" * 20_000, "nested too deep"),
        (b"x = " + b"9" * 5_000, "not valid TOML"),
        (b"[guard]\nmax_height_m = 1979-05-27\n", "guard.max_height_m"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_sentence(write, content, words):
    file = write(content)
    said = refusal([file])
    assert said.startswith(f"{file}: ")
    assert words in said
    assert "\n" not in said


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    assert "there is no such file" in refusal([tmp_path / "none.toml"])
    assert "cannot be read" in refusal([tmp_path])
    assert "none\\x00" in repr(refusal(["none\0"]))


def test_an_unknown_turbine_names_the_site(write):
    file = write('[[sites]]\nname = "T1"\nturbine = "nrel-5m"\n')
    said = refusal([file])
    assert said.startswith(f"{file}: sites.0.turbine: turbine 'nrel-5m' is not known; did you")


def test_two_sites_of_one_name_are_refused(write):
    site = '[[sites]]\nname = "T1"\nturbine = "nrel-5mw"\n'
    assert "sites.1.name = 'T1' is used twice" in refusal([write(site * 2)])


@pytest.mark.parametrize("name", scenario_names())
def test_packaged_scenarios_load_and_survive_being_written_as_effective_settings(name, write):
    settings = load_settings([scenario_path(name)], (), {})
    assert settings.sites
    text = to_toml(settings)
    assert tomllib.loads(text)
    assert load_settings([write(text)], (), {}) == settings


def test_the_scenarios_are_those_promised():
    assert set(scenario_names()) >= {"demo", "full", "crosswind", "behind"}
    with pytest.raises(ConfigError, match="scenario 'dmo' is not known"):
        scenario_path("dmo")
    full = load_settings([scenario_path("full")], (), {})
    assert len(full.inspection.blades) * len(full.inspection.sides) == 12


def _mutated(text: bytes, rng: random.Random) -> bytes:
    data = bytearray(text)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(data))
        piece = rng.choice(
            [b"nan", b"-inf", b'"', b"[", b"]]", b"\n", b"=", b"1e999", b"9" * 40, b"true", b"\0",
             b"{}", b"[[x]]", b"\xc3\x28", b"1979-05-27", b"''", b"#", rng.randbytes(3)]
        )  # fmt: skip
        match rng.randrange(4):
            case 0:
                data[at : at + rng.randint(1, 8)] = piece
            case 1:
                data[at:at] = piece
            case 2:
                del data[at : at + rng.randint(1, 30)]
            case _:
                other = rng.randrange(len(data) or 1)
                data[at:at] = data[other : other + rng.randint(1, 60)]
        data = data or bytearray(b"x")
    return bytes(data)


def test_five_hundred_damaged_files_are_loaded_or_refused_in_words(write):
    rng = random.Random(7)
    whole = to_toml(load_settings([scenario_path("demo")], (), {})).encode()
    said = []
    for _ in range(500):
        file = write(_mutated(whole, rng))
        try:
            load([file], (), {})
        except ConfigError as error:
            said.append(str(error))
    assert len(said) > 300
    assert all(line.startswith(str(file)) for text in said for line in text.splitlines())


def test_damaged_options_and_variables_are_taken_or_refused_in_words():
    rng = random.Random(8)
    keys = [key for key, _, _ in load([scenario_path("demo")], (), {}).leaves()]
    said = []
    for _ in range(500):
        key = list(rng.choice(keys))
        for _ in range(rng.randrange(3)):
            key[rng.randrange(len(key))] = rng.choice("._0[]ä\udcff" + string.ascii_letters)
        value = rng.choice(["", "nan", "[", "{a=1}", "1,2", "-1", "\udcff", "[[[]]]", "1e400", "'"])
        try:
            load([scenario_path("demo")], [f"{''.join(key)}={value}"], {})
            load([], (), {"BLADESCOUT_" + "__".join("".join(key).split(".")): value})
        except ConfigError as error:
            said.append(str(error))
    assert all(said)
