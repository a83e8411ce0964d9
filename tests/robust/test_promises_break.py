"""docs/security.md: tests that it names fail if their promises do not hold.

A copy of the Python sources is changed so that a promise does not hold, and its test is run there.
Promises that Rust keeps are not among these.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from patience import PATIENCE

ROOT = Path(__file__).parents[2]
LEFT_OUT = shutil.ignore_patterns(
    "target", ".git", ".venv", "__pycache__", ".*_cache", "benches", "pictures", "engine", "bridge"
)

# Test → file, and what is replaced in it by what.
BREAKS = {
    "scores/test_confined.py::test_what_lies_outside_is_refused": (
        "ergon/notation/text/bounds.py",
        "return any(real.is_relative_to(folder) for folder in self.folders)",
        "return True",
    ),
    "scores/test_confined.py::test_no_line_of_a_file_outside_is_told": (
        "ergon/notation/text/bounds.py",
        "return any(real.is_relative_to(folder) for folder in self.folders)",
        "return True",
    ),
    "cli/test_inputs_kept.py::test_an_input_is_never_written_over": (
        "ergon/exchange/safe.py",
        "if is_one_of(path, inputs):",
        "if False:",
    ),
    "robust/test_session_kills.py::test_six_kills_of_a_session": (
        "repl/session/journal.py",
        'path.open("xb", buffering=0)',
        'path.open("xb")',
    ),
    "repl/test_repl_saves.py::test_a_strangers_journal_writes_no_file": (
        "repl/session/journal_names.py",
        "    path = folder / _check_relative(name)\n    if not is_below(path, folder):\n",
        "    path = folder / name\n    if False:\n",
    ),
    "repl/test_journal_hostile.py::test_journal_file_name_outside_folder": (
        "repl/session/journal_names.py",
        "    if not is_below(path, folder):\n",
        "    if False:\n",
    ),
    "repl/test_journal_hostile.py::test_replay_of_python_lines": (
        "repl/session/replay.py",
        '    commands = reparse(event.get("line", str), on)\n',
        '    commands = reparse(event.get("line", str), on)\n'
        '    [exec(getattr(command, "expression", "")) for command in commands]\n',
    ),
    "scores/test_take_files.py::test_a_pickle_is_not_opened": (
        "scores/gesture/npz.py",
        '        if dtype.hasobject or dtype.kind not in "fiu" or len(shape) != 1:\n',
        "        if dtype.hasobject:\n            np.load(self._path, allow_pickle=True)[name]\n"
        '        if dtype.hasobject or dtype.kind not in "fiu" or len(shape) != 1:\n',
    ),
    "scores/test_corrupted_takes.py::test_damage_is_refused_with_a_sentence": (
        "scores/gesture/npz.py",
        "    except Exception as error:\n        why = ",
        "    except ImportError as error:\n        why = ",
    ),
    "plan/test_plan_store.py::test_a_broken_file_is_made_anew": (
        "ergon/exchange/plan_store.py",
        'and content.get("hash") == _hash(record)',
        "",
    ),
    "robust/test_conditions.py::test_no_reader_waits_for_what_is_no_file": (
        "ergon/common/regular.py",
        # A reader that went on would wait for ever; the test sees any other end.
        'raise NotRegularError(22, "not a regular file", str(path))',
        "raise ZeroDivisionError",
    ),
    "robust/test_conditions.py::test_load_takes_files_alone": (
        "ergon/common/regular.py",
        # A reader that went on would wait for ever; the test sees any other end.
        'raise NotRegularError(22, "not a regular file", str(path))',
        "raise ZeroDivisionError",
    ),
    "exchange/test_layout_files.py::test_files_of_strangers_are_refused": (
        "ergon/exchange/layout_files.py",
        "if isinstance(event, yaml.AliasEvent):",
        "if False:",
    ),
    "exchange/test_adm.py::test_xml_of_strangers_is_refused": (
        "ergon/common/xml_text.py",
        "if _DEFINES.search(data):",
        "if False:",
    ),
    "cli/test_terminal_text.py::test_no_message_steers_a_terminal": (
        "ergon/common/terminal.py",
        'return _STEERING.sub("?", shown(text))',
        "return text",
    ),
    "robust/test_conditions.py::test_the_largest_file_that_may_be_is_a_full_disk": (
        "ergon/exchange/safe.py",
        "part.unlink(missing_ok=True)",
        "pass",
    ),
    "robust/test_rights.py::test_what_a_command_writes_has_the_right_rights": (
        "cli/app.py",
        "    set_umask()\n",
        "",
    ),
    "robust/test_rights.py::test_a_replaced_file_keeps_its_rights": (
        "ergon/exchange/safe.py",
        "path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~umask",
        "0o666 & ~umask",
    ),
    "robust/test_rights.py::test_a_file_in_the_making_is_its_owners_alone": (
        "ergon/exchange/temporary.py",
        "_FLAGS, 0o600)",
        "_FLAGS, 0o666)",
    ),
    "robust/test_rights.py::test_what_others_can_have_changed_in_the_cache_is_not_read": (
        "ergon/exchange/cache_folder.py",
        "if not (is_own_alone(self.path.stat()) and is_own_alone(path.stat())):",
        "if False:",
    ),
    "robust/test_rights.py::test_a_cache_of_another_user_is_neither_read_nor_written": (
        "ergon/common/private.py",
        "return is_own(status) and not",
        "return not",
    ),
    "robust/test_second_user.py::test_workers_of_this_machine_answer_nobody_else": (
        "ergon/api/local_workers.py",
        '        """Serve no pages."""\n',
        "        super().start_http_server(*_arguments, **_options)\n",
    ),
    "robust/test_second_user.py::test_osc_and_pages_of_a_performance_are_the_players_alone": (
        "ergon/live/osc_senders.py",
        "if any(row.user not in (_ROOT, os.geteuid()) for row in senders):",
        "if False:",
    ),
    "live/test_live_osc_senders.py::test_a_second_user_is_not_heard_by_whatever_socket": (
        "ergon/live/osc_senders.py",
        "if noted.is_shared:",
        "if False:",
    ),
    "live/test_live_osc_senders.py::test_sender_of_a_shared_port_needs_the_key": (
        "ergon/live/osc.py",
        "hmac.compare_digest(key.encode(), self._key.encode())",
        "self._key.startswith(key)",
    ),
    "live/test_live_osc_senders.py::test_where_the_system_does_not_tell_a_force_needs_the_key": (
        "ergon/live/osc.py",
        "if self._has_hands() and not is_harmless(address):",
        "if False:",
    ),
    "repl/test_repl_place.py::test_the_place_is_its_owners_alone": (
        "repl/wire/local_socket.py",
        "os.chmod(path, 0o600)",
        "os.chmod(path, 0o644)",
    ),
    "repl/test_repl_place.py::test_a_process_of_another_user_is_refused_though_it_can_connect": (
        "repl/wire/local_socket.py",
        "return bool(user == os.geteuid())",
        "return True",
    ),
    "repl/test_repl_socket.py::test_hostile_bytes_leave_other_clients_served": (
        "repl/wire/serve.py",
        "        except ProtocolError as error:\n"
        "            prompt.send(id=number, error=str(error))\n",
        "        except ProtocolError as error:\n            self._end(str(error))\n",
    ),
    "live/test_live_osc.py::test_a_place_is_this_machine_unless_a_host_is_named": (
        "ergon/live/osc.py",
        'LOOPBACK = "127.0.0.1"',
        'LOOPBACK = "0.0.0.0"',
    ),
    "live/test_live_osc.py::test_strange_bytes_are_messages_or_malformed": (
        "ergon/live/datagrams.py",
        "        except Exception:  # whatever strange bytes make of a parser\n",
        "        except ImportError:\n",
    ),
    "repl/test_repl_osc.py::test_what_needs_a_password_is_not_done": (
        "repl/session/osc.py",
        ", barred=_TYPED_ONLY)",
        ")",
    ),
}


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources, with the built core."""
    folder = tmp_path_factory.mktemp("copied") / "ergon"
    shutil.copytree(ROOT, folder, symlinks=True, ignore=LEFT_OUT)
    shutil.copytree(ROOT / "tests" / "engine", folder / "tests" / "engine")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("test", BREAKS)
def test_a_promise_that_does_not_hold_is_found(copied: Path, test: str) -> None:
    name, before, after = BREAKS[test]
    source = copied / name
    text = source.read_text(encoding="utf-8")
    assert before in text
    try:
        source.write_text(text.replace(before, after), encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", f"tests/{test}"],
            cwd=copied,
            env={**os.environ, "PYTHONPATH": str(copied / "core-rs" / "python")},
            stdout=subprocess.PIPE,
            text=True,
            timeout=PATIENCE,
        )
    finally:
        source.write_text(text, encoding="utf-8")
    assert done.returncode == 1, done.stdout
    assert "1 failed" in done.stdout


def test_every_break_is_of_a_promise_and_of_a_line_that_is_there() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    for test, (name, before, _) in BREAKS.items():
        assert f"`tests/{test}`" in page
        assert before in (ROOT / name).read_text(encoding="utf-8"), name
