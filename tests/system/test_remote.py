"""The daemon as it is installed, asked over TLS by the commands."""

import json

from mission.cli.exits import Exit


def test_over_tls_each_may_do_what_its_certificate_says(
    bladescout, daemon, free_port, tmp_path, wait_for
):
    names = ("--vehicle", "drone-1=127.0.0.1", "--operator", "ada", "--viewer", "eve")
    assert bladescout("keys", tmp_path / "keys", *names).wait(60).code == Exit.DONE
    router = f"tls/127.0.0.1:{free_port()}"
    serving = daemon(
        "--set", f"bus.remote={router}", "--set", f"bus.keys={tmp_path / 'keys' / 'drone-1'}"
    )
    assert wait_for(serving.words, 120)

    def ask(who, *words):
        run = bladescout(*words, "--router", router, "--keys", tmp_path / "keys" / who)
        return run.wait(60)

    start = ("start", "one", "--operator", "A. Person", "--rotor-locked")
    seen = ask("eve", "status", "--json")
    assert seen.code == Exit.DONE, seen.stderr
    assert json.loads(seen.stdout)["ok"]
    denied = ask("eve", *start)
    assert denied.code == Exit.DEVICE
    assert denied.sentence == "drone-1: no reply: not running, or not authorised"
    # There is no vehicle anywhere: that the operator is told so shows that it was let in.
    refused = ask("ada", *start)
    assert refused.code in (Exit.DEVICE, Exit.REFUSED)
    assert "(no_vehicle)" in refused.sentence
    stranger = bladescout("status", "--router", router).wait(60)
    assert stranger.code == Exit.CONFIGURATION
    assert "bladescout keys" in stranger.sentence
    assert serving.run.process.poll() is None
    assert not list((tmp_path / "missions").glob("*"))


def test_a_bus_that_is_open_to_all_is_not_opened(bladescout, free_port):
    open_to_all = f"bus.listen=tcp/0.0.0.0:{free_port()}"
    refused = bladescout("serve", "--set", open_to_all).wait(60)
    assert refused.code == Exit.CONFIGURATION
    assert "bus.remote" in refused.sentence
