"""A key comes from a private file or the environment, and no word of it is ever shown."""

import base64
import copy
import hashlib
import os
import pickle

import pytest

from drivers.errors import LinkError
from drivers.mavlink.signing_key import SigningKey

SECRET = bytes(range(200, 232))


def written(path, text, mode=0o600):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    path.chmod(mode)
    return path


def is_the_key(key):
    return key.digest().digest() == hashlib.sha256(SECRET).digest()


SPELLINGS = [
    pytest.param(SECRET.hex(), id="hex"),
    pytest.param(SECRET.hex().upper() + "\n", id="upper case, end of line"),
    pytest.param(base64.b64encode(SECRET).decode() + "\n", id="base64"),
]


@pytest.mark.parametrize("text", SPELLINGS)
def test_a_private_file_gives_the_key(tmp_path, text):
    assert is_the_key(SigningKey.from_file(written(tmp_path / "key", text)))
    assert is_the_key(SigningKey.from_file(written(tmp_path / "read-only", text, 0o400)))


@pytest.mark.parametrize("text", SPELLINGS)
def test_the_environment_gives_the_key(text):
    assert is_the_key(SigningKey.from_environment("SWARM_KEY", {"SWARM_KEY": text}))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "correct horse battery staple",
        SECRET.hex()[:-1],
        SECRET.hex() + "00",
        "g" * 64,
        base64.b64encode(SECRET[:-1]).decode(),
        SECRET,
        b"\xff" * 64,
        "a" * 100_000,
    ],
)
def test_anything_else_is_refused_with_what_is_wanted_and_not_shown(tmp_path, text):
    path = written(tmp_path / "key", text)
    with pytest.raises(LinkError, match=r"64 hexadecimal characters, or base64 of 32 bytes.*openssl") as caught:
        SigningKey.from_file(path)
    assert str(path) in str(caught.value)
    if text:
        assert str(text)[:8] not in str(caught.value)


def test_a_key_of_all_zeros_is_refused(tmp_path):
    with pytest.raises(LinkError, match="all zero switches signing off"):
        SigningKey.from_file(written(tmp_path / "key", "0" * 64))


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o660, 0o604, 0o666])
def test_a_file_open_to_others_is_refused_with_its_mode(tmp_path, mode):
    path = written(tmp_path / "key", SECRET.hex(), mode)
    with pytest.raises(LinkError, match=rf"{path} is open to others \(mode {mode:04o}\): chmod 600"):
        SigningKey.from_file(path)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_a_file_of_another_user_is_refused(tmp_path):
    path = written(tmp_path / "key", SECRET.hex())
    os.chown(path, 12345, -1)
    with pytest.raises(LinkError, match=r"belongs to user 12345, this runs as user 0"):
        SigningKey.from_file(path)


def test_a_file_that_is_not_there_or_no_file_is_refused(tmp_path):
    with pytest.raises(LinkError, match="absent cannot be read: No such file"):
        SigningKey.from_file(tmp_path / "absent")
    with pytest.raises(LinkError, match="is no regular file"):
        SigningKey.from_file(tmp_path)
    os.mkfifo(tmp_path / "pipe", 0o600)
    with pytest.raises(LinkError, match="is no regular file"):
        SigningKey.from_file(tmp_path / "pipe")


def test_an_unset_variable_is_refused_by_name():
    with pytest.raises(LinkError, match="environment variable SWARM_KEY is not set"):
        SigningKey.from_environment("SWARM_KEY", {})


def test_a_key_given_where_its_place_is_wanted_is_not_shown(tmp_path):
    for make in (lambda: SigningKey.from_environment(SECRET.hex(), {}), lambda: SigningKey.from_file(SECRET.hex())):
        with pytest.raises(LinkError, match="a key was given where its place is wanted") as caught:
            make()
        assert SECRET.hex() not in str(caught.value)
        assert caught.value.__cause__ is None


def test_nothing_made_of_a_key_shows_it():
    key = SigningKey(SECRET)
    assert repr(key) == str(key) == f"{key}" == "SigningKey(not shown)"
    for export in (pickle.dumps, copy.deepcopy, vars):
        with pytest.raises(TypeError):
            export(key)
