"""Tokens and where a screen may be served."""

import pytest

from gcs.errors import ServiceError
from gcs.monitor.access import (
    COMMAND_VARIABLE,
    VIEW_VARIABLE,
    Role,
    Token,
    Tokens,
    is_loopback,
    read_tokens,
    require_guarded,
)

VIEW = "view-0123456789abcdef"
COMMAND = "command-0123456789abcdef"


def private(path, text, mode=0o600):
    path.write_text(text)
    path.chmod(mode)
    return path


def test_a_token_gives_its_own_role_and_nothing_else_gives_any():
    tokens = Tokens(Token(VIEW), Token(COMMAND))
    assert tokens.role_of(VIEW) is Role.VIEW
    assert tokens.role_of(COMMAND) is Role.COMMAND
    assert tokens.role_of("") is tokens.role_of(VIEW[:-1]) is tokens.role_of(VIEW + "x") is Role.NOBODY
    assert tokens.open_role is Role.NOBODY


def test_without_a_token_all_may_view_and_nobody_command():
    assert Tokens().open_role is Role.VIEW
    assert Tokens().role_of(COMMAND) is Role.NOBODY
    assert Tokens(command=Token(COMMAND)).open_role is Role.VIEW


def test_a_token_is_not_shown():
    token = Token(COMMAND)
    assert COMMAND not in repr(token)
    assert COMMAND not in repr(Tokens(command=token))
    assert COMMAND not in token.sign("anything")
    assert not [name for name in dir(token) if not name.startswith("__") and getattr(token, name) == COMMAND]


def test_tokens_come_from_files_before_the_environment(tmp_path):
    path = private(tmp_path / "token", COMMAND + "\n")
    tokens = read_tokens(None, path, {COMMAND_VARIABLE: "another-0123456789", VIEW_VARIABLE: VIEW})
    assert tokens.role_of(COMMAND) is Role.COMMAND
    assert tokens.role_of("another-0123456789") is Role.NOBODY
    assert tokens.role_of(VIEW) is Role.VIEW
    assert read_tokens(None, None, {}) == Tokens()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644])
def test_a_token_file_that_others_can_read_is_refused_without_showing_it(tmp_path, mode):
    path = private(tmp_path / "token", COMMAND, mode)
    with pytest.raises(ServiceError, match="chmod 600") as refusal:
        read_tokens(None, path, {})
    assert COMMAND not in str(refusal.value)


@pytest.mark.parametrize("text", ["", "short", "two lines of\ntext 0123456789", "ünlesbar-0123456789abc"])
def test_what_is_no_token_is_refused_with_the_way_to_make_one(tmp_path, text):
    with pytest.raises(ServiceError, match="openssl rand"):
        read_tokens(private(tmp_path / "token", text), None, {})


def test_a_token_file_that_is_not_there_or_a_folder_is_refused(tmp_path):
    with pytest.raises(ServiceError, match="cannot be read"):
        read_tokens(tmp_path / "none", None, {})
    with pytest.raises(ServiceError, match="no regular file"):
        read_tokens(tmp_path, None, {})


def test_one_token_for_both_is_refused():
    with pytest.raises(ServiceError, match="the same"):
        read_tokens(None, None, {VIEW_VARIABLE: VIEW, COMMAND_VARIABLE: VIEW})


@pytest.mark.parametrize("host", ["127.0.0.1", "127.3.2.1", "::1", "localhost"])
def test_loopback_needs_neither_tls_nor_a_token(host):
    assert is_loopback(host)
    require_guarded(host, Tokens(), tls=False, insecure=False)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "field-laptop", "localhost.example.org"])
def test_off_loopback_needs_tls_or_the_word_that_it_is_insecure_and_a_token_for_viewing(host):
    tokens = Tokens(view=Token(VIEW))
    assert not is_loopback(host)
    with pytest.raises(ServiceError, match="--insecure"):
        require_guarded(host, tokens, tls=False, insecure=False)
    with pytest.raises(ServiceError, match="--view-token-file"):
        require_guarded(host, Tokens(command=Token(COMMAND)), tls=True, insecure=False)
    require_guarded(host, tokens, tls=True, insecure=False)
    require_guarded(host, tokens, tls=False, insecure=True)
