"""The services of the gateway's node of ROS 2, asked by a plain Zenoh client in another process as `rmw_zenoh` asks: complete
queryables, request and attachment as its design document has them. `rosbags` writes requests, reads answers and computes hashes."""

import json
import re
import struct
import time

import numpy as np
import pytest
import zenoh
from ros2_types import STORE, key, make
from test_plain_client import PATIENCE_S, Stage
from test_ros2 import MODEL, SETTINGS

SERVICES = {
    "softtwin/finger/describe": "std_srvs/srv/Trigger",
    "softtwin/finger/what_if": "softtwin_interfaces/srv/WhatIf",
    "softtwin/finger/find_pressure": "softtwin_interfaces/srv/FindPressure",
    "softtwin/finger/find_gap": "softtwin_interfaces/srv/FindGap",
}
NOTHING_MORE = dict(parameter_names=[], parameters=np.zeros(0), node_set="")
CLIENT = bytes(range(100, 116))


@pytest.fixture
def stage(tmp_path):
    made = Stage(tmp_path)
    yield made
    made.close()


def beside(number):
    return struct.pack("<qqB", number, time.time_ns(), 16) + CLIENT


def replies(session, name, payload, attachment):
    target = zenoh.QueryTarget.ALL_COMPLETE
    got = session.get(name, payload=payload, attachment=attachment, target=target, timeout=PATIENCE_S)
    return list(got)


def ask(session, service, number=1, **fields):
    """Asks until the service is there; checks what every answer has."""
    kind = SERVICES[service]
    request = bytes(STORE.serialize_cdr(make(f"{kind}_Request", **fields), f"{kind}_Request"))
    end = time.monotonic() + PATIENCE_S
    while not (got := replies(session, key(service, kind), request, beside(number))):
        assert time.monotonic() < end, f"{service} is not there"
    (reply,) = got
    assert reply.ok, bytes(reply.err.payload)
    assert str(reply.ok.key_expr) == key(service, kind)
    found, stamp, length = struct.unpack_from("<qqB", bytes(reply.ok.attachment))
    assert (found, length, bytes(reply.ok.attachment)[17:]) == (number, 16, CLIENT), "number and client of the request"
    assert abs(stamp * 1e-9 - time.time()) < PATIENCE_S
    raw = bytes(reply.ok.payload)
    answer = STORE.deserialize_cdr(raw, f"{kind}_Response")
    assert bytes(STORE.serialize_cdr(answer, f"{kind}_Response")) == raw, f"{kind}: rosbags writes the same bytes"
    return answer


def test_services_stand_in_the_graph(stage):
    # The hash of the design document's example: hashes of services are computed rightly.
    assert STORE.hash_rihs01("example_interfaces/srv/AddTwoInts").startswith("RIHS01_e118de6bf5eeb66a2491b5bda11202e7")
    stage.live(200.0, SETTINGS)
    with stage.session("client") as session:
        end = time.monotonic() + PATIENCE_S
        while True:
            tokens = [str(reply.ok.key_expr).split("/") for reply in session.liveliness().get("@ros2_lv/**")]
            servers = [token for token in tokens if token[5] == "SS"]
            if len(servers) == len(SERVICES) or time.monotonic() > end:
                break
            time.sleep(0.05)
        assert len({token[4] for token in tokens}) == len(tokens), "each entity has its own number"
        found = {token[9].replace("%", "/")[1:]: token for token in servers}
        assert set(found) == set(SERVICES)
        for service, kind in SERVICES.items():
            token = found[service]
            assert token[:2] == ["@ros2_lv", "7"] and token[6:9] == ["%", "%", "twins"]
            assert token[10:12] == key(service, kind).rsplit("/", 2)[1:] and token[12] == "::,10:,:,:,,"


def test_a_twin_describes_itself(stage):
    stage.live(200.0, SETTINGS)
    with stage.session("client") as session:
        answer = ask(session, "softtwin/finger/describe", 3)
        assert answer.success
        said = json.loads(answer.message)
        assert said["actuator"] == "finger" and said["model"]["name"] == "pneunet"
        card = json.loads((MODEL.parent / "pneunet.card.json").read_text())
        ranges = [(one["name"], [one["min"], one["max"]]) for one in card["inputs"]]
        assert [(one["name"], one["range"]) for one in said["model"]["inputs"]] == ranges
        assert said["state"]["model_hash"] == card["file_hash"][:32]
        # The state is one of those that the twin sends as JSON.
        newer = json.loads(bytes(next(iter(session.get("softtwin/finger/state"))).ok.payload))
        assert set(said["state"]) == set(newer) and said["state"]["boot_id"] == newer["boot_id"]
        assert 0 < said["state"]["seq"] <= newer["seq"] and said["state"]["gap_mm"] == 30.0
        # Twin and bridge are gone; the gateway, started last, stays.
        for child in stage.programs[:2]:
            child.kill()
            child.wait()
        end = time.monotonic() + PATIENCE_S
        while (answer := ask(session, "softtwin/finger/describe")).success:
            assert time.monotonic() < end, "a dead twin is described"
        assert answer.message.startswith("no state of finger")
        (reply,) = replies(session, key("softtwin/finger/describe", "std_srvs/srv/Trigger"), b"\0\1\0", beside(1))
        assert "expected an empty request in little-endian CDR" in bytes(reply.err.payload).decode()


def question(session, service, **given):
    return ask(session, f"softtwin/finger/{service}", **{**NOTHING_MORE, **given})


def test_questions_are_answered_as_by_zenoh(stage):
    stage.live(200.0, SETTINGS)
    asked = [
        ("what_if", "whatif", dict(pressure_mpa=0.05, gap_mm=30.0)),
        ("what_if", "whatif", dict(pressure_mpa=0.01, gap_mm=60.0)),
        ("what_if", "whatif", dict(pressure_mpa=0.1, gap_mm=30.0)),  # outside: no half-widths
        ("find_pressure", "pressure", dict(force_n=0.3, gap_mm=30.0)),
        ("find_gap", "gap", dict(pressure_mpa=0.06, force_n=0.3, force_halfwidth_n=0.01)),
    ]
    same = "pressure_mpa gap_mm contact_force_n force_halfwidth_n onset_pressure_mpa displacement_halfwidth_mm von_mises_halfwidth_mpa"
    same += " domain_distance domain_status regime flags model_hash"
    with stage.session("client") as session:
        for service, name, values in asked:
            for node_set in ("", "surface"):
                answer = question(session, service, **values, node_set=node_set)
                assert (answer.success, answer.message) == (True, "")
                found = answer.answer
                text = ";".join(f"{key}={value}" for key, value in values.items()) + (f";field={node_set}" if node_set else "")
                (reply,) = session.get(f"softtwin/finger/{name}?{text}", timeout=PATIENCE_S)
                said = json.loads(bytes(reply.ok.attachment if node_set else reply.ok.payload))
                for key_ in same.split():
                    wanted = said[key_] if not isinstance(said[key_], str) or key_ in ("regime", "model_hash") else float(said[key_])
                    np.testing.assert_equal(getattr(found, key_), float("nan") if wanted is None else wanted, key_)
                assert found.input_names == ["pressure_mpa", "gap_mm"] == said["input_names"]
                assert found.inputs.tolist() == said["inputs"] and found.force_by_input.tolist() == said["force_by_input"]
                ends = [found.found_halfwidth, found.found_low, found.found_high]
                np.testing.assert_equal(ends, [float("nan" if said[key_] is None else said[key_]) for key_ in ("uncertainty", "low", "high")])
                is_outside = values.get("pressure_mpa") == 0.1
                assert (found.domain_status, np.isnan(found.force_halfwidth_n)) == ((2, True) if is_outside else (0, False))
                if node_set:
                    assert (found.node_count, found.field_names) == (said["node_count"], said["fields"])
                    assert found.field.tobytes() == bytes(reply.ok.payload)
                    assert (found.max_von_mises_mpa, found.max_von_mises_node) == (said["max_von_mises_mpa"], said["max_von_mises_node"])
                else:
                    assert (found.node_count, found.field_names, len(found.field)) == (0, [], 0) and np.isnan(found.max_von_mises_mpa)


def test_why_there_is_no_answer_stands_in_the_response(stage):
    stage.live(200.0, SETTINGS)
    state = dict(pressure_mpa=0.05, gap_mm=30.0)
    two, many = ["a", "b"], [f"parameter{at}" for at in range(7)]
    refused = [
        ("find_pressure", dict(force_n=1000.0, gap_mm=30.0), "more force than the sampled states give here: at most"),
        ("what_if", dict(pressure_mpa=float("nan"), gap_mm=30.0), "missing or not finite"),
        ("what_if", dict(pressure_mpa=0.3, gap_mm=30.0), "pressure_mpa is 0.21 above the largest trained value"),
        ("what_if", dict(state, parameter_names=["mu"], parameters=np.ones(1)), "no input of this model, which has pressure_mpa, gap_mm"),
        ("what_if", dict(state, parameter_names=two, parameters=np.ones(1)), "expected as many parameters as parameter_names, found 1 and 2"),
        ("what_if", dict(state, parameter_names=many, parameters=np.ones(7)), "expected at most 6 parameters, found 7"),
        ("what_if", dict(state, node_set="a b"), "expected the name of a node set in node_set, found"),
        ("what_if", dict(state, node_set="other"), "the twin offers no field of these nodes"),
    ]
    with stage.session("client") as session:
        for service, values, reason in refused:
            answer = question(session, service, **values)
            assert not answer.success and reason in answer.message, answer.message
            # Without such a field the state is there all the same.
            assert np.isnan(answer.answer.contact_force_n) == (values.get("node_set") != "other") and len(answer.answer.field) == 0
        (reply,) = replies(session, key("softtwin/finger/what_if", SERVICES["softtwin/finger/what_if"]), b"\0\1\0\0", beside(1))
        assert "expected a request to what_if of at most 64 parameters in little-endian CDR" in bytes(reply.err.payload).decode()
        assert question(session, "what_if", **state).success
        for child in stage.programs[:2]:
            child.kill()
            child.wait()
        answer = question(session, "what_if", **state)
        assert not answer.success and "finger" in answer.message, answer.message


def test_requests_that_are_none_are_refused(stage):
    stage.live(200.0, SETTINGS)
    service = "softtwin/finger/what_if"
    kind = SERVICES[service]
    state = dict(NOTHING_MORE, pressure_mpa=0.05, gap_mm=30.0)
    good = bytes(STORE.serialize_cdr(make(f"{kind}_Request", **state), f"{kind}_Request"))
    other = key(service, kind).rsplit("/", 1)[0] + "/RIHS01_" + "0" * 64
    with stage.session("client") as session:
        ask(session, service, **state)
        bad = [
            (other, good, beside(1), "expected type hash RIHS01_9f2ac41a"),
            (key(service, kind), good[:-3], beside(1), "little-endian CDR"),
            (key(service, kind), None, beside(1), "little-endian CDR"),
            (key(service, kind), good[:1] + b"\0" + good[2:], beside(1), "little-endian CDR"),
            (key(service, kind), good, None, "expected an attachment"),
            (key(service, kind), good, beside(1)[:-1], "expected an attachment"),
            (key(service, kind), bytes(70_000), beside(1), "expected at most 65536 bytes, found 70000"),
        ]
        for name, payload, attachment, said in bad:
            (reply,) = replies(session, name, payload, attachment)
            assert reply.ok is None and said in bytes(reply.err.payload).decode()
        ask(session, service, **state)
    log = stage.end_last()
    assert log.count("logged once per service") == 1 and "expected type hash RIHS01_9f2ac41a" in log
    (line,) = re.findall(r"ended: .*", log)
    counts = dict(word.split("=") for word in line.split() if "=" in word)
    assert (int(counts["refusals"]), int(counts["answers"])) == (len(bad), 2)
