from cryptography.x509 import SubjectAlternativeName
from typer.testing import CliRunner

from drivers.bus_access import Role, read_roles
from drivers.certificates import common_name, read_certificate
from mission.cli.exits import Exit
from mission.cli.main import app

SITE = ("--vehicle", "heron=192.168.1.5", "--operator", "ada", "--viewer", "eve", "--pilot", "pia")


def keys(*words):
    return CliRunner().invoke(app, ["keys", *map(str, words)])


def test_one_command_makes_all_that_a_site_needs(tmp_path):
    made = keys(tmp_path / "keys", *SITE)
    assert made.exit_code == Exit.DONE, made.output
    for name in ("heron", "ada", "eve", "pia"):
        folder = tmp_path / "keys" / name
        assert common_name(folder / "cert.pem") == name
        assert (folder / "key.pem").stat().st_mode & 0o077 == 0
        authority = read_certificate(folder / "ca.pem")
        read_certificate(folder / "cert.pem").verify_directly_issued_by(authority)
    assert read_roles(tmp_path / "keys" / "heron") == {
        "heron": Role.VEHICLE,
        "ada": Role.OPERATOR,
        "pia": Role.PILOT,
        "eve": Role.VIEWER,
    }
    assert not (tmp_path / "keys" / "heron" / "ca.key").exists()
    assert not (tmp_path / "keys" / "ada" / "roles.toml").exists()
    assert (tmp_path / "keys" / "ca.key").stat().st_mode & 0o077 == 0


def test_the_vehicles_certificate_names_its_address(tmp_path):
    keys(tmp_path, *SITE)
    certificate = read_certificate(tmp_path / "heron" / "cert.pem")
    names = certificate.extensions.get_extension_for_class(SubjectAlternativeName).value
    assert "192.168.1.5" in {str(name.value) for name in names}


def test_what_is_there_is_kept_and_what_is_new_added(tmp_path):
    keys(tmp_path, *SITE)
    before = (tmp_path / "ada" / "cert.pem").read_bytes(), (tmp_path / "ca.pem").read_bytes()
    keys(tmp_path, "--operator", "ada", "--viewer", "bob")
    assert ((tmp_path / "ada" / "cert.pem").read_bytes(), (tmp_path / "ca.pem").read_bytes()) == (
        before
    )
    assert read_roles(tmp_path / "heron")["bob"] is Role.VIEWER
    keys(tmp_path, "--operator", "ada", "--renew")
    assert (tmp_path / "ada" / "cert.pem").read_bytes() != before[0]


def test_who_is_removed_is_no_longer_on_the_vehicles_list(tmp_path):
    keys(tmp_path, *SITE)
    keys(tmp_path, "--remove", "ada")
    assert "ada" not in read_roles(tmp_path / "heron")


def test_a_name_that_could_reach_elsewhere_is_refused(tmp_path):
    for name in ("../up", "a/b", "*", "local", "", "x" * 40):
        refused = keys(tmp_path, "--viewer", name)
        assert refused.exit_code == Exit.CONFIGURATION
        assert "is not a name" in refused.output
    assert list(tmp_path.iterdir()) == []


def test_one_name_has_one_role(tmp_path):
    assert keys(tmp_path, "--viewer", "a", "--operator", "a").exit_code == Exit.CONFIGURATION


def test_a_machine_never_becomes_a_person_and_a_change_of_rights_is_told(tmp_path):
    keys(tmp_path, *SITE)
    for words in (("--operator", "heron"), ("--vehicle", "ada=192.168.1.6")):
        refused = keys(tmp_path, *words)
        assert refused.exit_code == Exit.CONFIGURATION
        assert "already" in refused.stderr
    assert read_roles(tmp_path / "heron")["heron"] is Role.VEHICLE
    told = keys(tmp_path, "--operator", "eve")
    assert "eve: operator from now on, viewer before" in told.stdout


def test_who_is_not_there_cannot_be_removed(tmp_path):
    keys(tmp_path, *SITE)
    refused = keys(tmp_path, "--remove", "adda")
    assert refused.exit_code == Exit.CONFIGURATION
    assert "adda" in refused.stderr
    assert "ada" in read_roles(tmp_path / "heron")


def test_a_vehicle_without_an_address_is_told_that_it_needs_one(tmp_path):
    assert "heron=HOST" in keys(tmp_path, "--vehicle", "heron").stdout


def test_a_router_needs_the_folder_of_one_who_is_asked(tmp_path):
    keys(tmp_path, *SITE)
    words = ["router", "--keys", str(tmp_path / "ada"), "--listen", "tcp/127.0.0.1:1"]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == Exit.CONFIGURATION
    assert "roles.toml is missing" in refused.stderr
