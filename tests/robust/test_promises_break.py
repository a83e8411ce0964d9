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
    "scores/test_confined.py::test_files_outside_score_folder_are_refused": (
        "ergon/notation/text/bounds.py",
        "return any(real_path.is_relative_to(folder) for folder in self.folders)",
        "return True",
    ),
    "scores/test_confined.py::test_check_output_hides_text_of_outside_file": (
        "ergon/notation/text/bounds.py",
        "return any(real_path.is_relative_to(folder) for folder in self.folders)",
        "return True",
    ),
    "cli/test_inputs_kept.py::test_commands_never_overwrite_their_inputs": (
        "ergon/exchange/safe.py",
        "if is_one_of(path, inputs):",
        "if False:",
    ),
    "robust/test_session_kills.py::test_session_lines_preserved_after_six_kills": (
        "repl/session/journal.py",
        'path.open("xb", buffering=0)',
        'path.open("xb")',
    ),
    "repl/test_repl_saves.py::test_journal_with_foreign_paths_saves_no_file": (
        "repl/session/journal_names.py",
        "    path = folder / _check_relative(written_name)\n    if not is_below(path, folder):\n",
        "    path = folder / name\n    if False:\n",
    ),
    "repl/test_journal_hostile.py::test_journal_file_name_outside_folder": (
        "repl/session/journal_names.py",
        "    if not is_below(path, folder):\n",
        "    if False:\n",
    ),
    "repl/test_journal_hostile.py::test_replay_of_python_lines": (
        "repl/session/replay.py",
        '    commands = reparse(line_event.get("line", str), old_version)\n',
        '    commands = reparse(line_event.get("line", str), old_version)\n'
        '    [exec(getattr(command, "expression", "")) for command in commands]\n',
    ),
    "scores/test_take_files.py::test_npz_with_pickled_objects_is_refused": (
        "scores/gesture/npz.py",
        '        if dtype.hasobject or dtype.kind not in "fiu" or len(array_shape) != 1:\n',
        "        if dtype.hasobject:\n"
        "            np.load(self._path, allow_pickle=True)[member_name]\n"
        '        if dtype.hasobject or dtype.kind not in "fiu" or len(array_shape) != 1:\n',
    ),
    "scores/test_corrupted_takes.py::test_damaged_takes_are_refused": (
        "scores/gesture/npz.py",
        "    except Exception as error:\n        reason = ",
        "    except ImportError as error:\n        reason = ",
    ),
    "plan/test_plan_store.py::test_plan_store_rewrites_damaged_files": (
        "ergon/exchange/plan_store.py",
        'and record_content.get("hash") == _record_hash(trial_record)',
        "",
    ),
    "robust/test_conditions.py::test_readers_refuse_fifos_folders_and_devices": (
        "ergon/common/regular.py",
        # A reader that went on would wait for ever; the test sees any other end.
        'raise NotRegularError(22, "not a regular file", str(path))',
        "raise ZeroDivisionError",
    ),
    "robust/test_conditions.py::test_load_refuses_non_files": (
        "ergon/common/regular.py",
        # A reader that went on would wait for ever; the test sees any other end.
        'raise NotRegularError(22, "not a regular file", str(path))',
        "raise ZeroDivisionError",
    ),
    "exchange/test_layout_files.py::test_malformed_layout_files_are_refused": (
        "ergon/common/yaml_text.py",
        "if isinstance(yaml_event, yaml.AliasEvent):",
        "if False:",
    ),
    "exchange/test_adm.py::test_hostile_xml_is_refused": (
        "ergon/common/xml_text.py",
        "if _DEFINITION_PATTERN.search(xml_bytes):",
        "if False:",
    ),
    "cli/test_terminal_text.py::test_messages_without_terminal_control_characters": (
        "ergon/common/terminal.py",
        'return _STEERING.sub("?", shown(text))',
        "return text",
    ),
    "robust/test_conditions.py::test_file_size_limit_refused_without_partial_files": (
        "ergon/exchange/safe.py",
        "path.unlink(missing_ok=True)",
        "pass",
    ),
    "robust/test_rights.py::test_file_modes_of_commands_under_umask": (
        "cli/app.py",
        "    set_umask()\n",
        "",
    ),
    "robust/test_rights.py::test_replaced_file_preserves_mode": (
        "ergon/exchange/safe.py",
        "path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~umask",
        "0o666 & ~umask",
    ),
    "robust/test_rights.py::test_temporary_file_private_to_owner": (
        "ergon/exchange/temporary.py",
        "_FLAGS, 0o600)",
        "_FLAGS, 0o666)",
    ),
    "robust/test_rights.py::test_cache_writable_by_others_ignored": (
        "ergon/exchange/cache_folder.py",
        "if not (is_own_alone(self.path.stat()) and is_own_alone(path.stat())):",
        "if False:",
    ),
    "robust/test_rights.py::test_cache_of_another_user_ignored": (
        "ergon/common/private.py",
        "return is_own(status) and not",
        "return not",
    ),
    "robust/test_second_user.py::test_local_workers_reject_second_user": (
        "ergon/api/local_workers.py",
        '        """Serve no pages."""\n',
        "        super().start_http_server(*_arguments, **_options)\n",
    ),
    "robust/test_second_user.py::test_osc_and_pages_reject_second_user": (
        "ergon/live/osc_senders.py",
        "if any(row.user_id not in (_ROOT, os.geteuid()) for row in senders):",
        "if False:",
    ),
    "live/test_live_osc_senders.py::test_osc_from_second_user_ignored": (
        "ergon/live/osc_senders.py",
        "if known_sender.is_shared:",
        "if False:",
    ),
    "live/test_live_osc_senders.py::test_sender_of_a_shared_port_needs_the_key": (
        "ergon/live/osc.py",
        "hmac.compare_digest(key.encode(), self._key.encode())",
        "self._key.startswith(key)",
    ),
    "live/test_live_osc_senders.py::test_osc_force_needs_key_without_socket_tables": (
        "ergon/live/osc.py",
        "if self._has_hands() and not is_harmless(address):",
        "if False:",
    ),
    "repl/test_repl_place.py::test_default_socket_path_permissions": (
        "repl/wire/local_socket.py",
        "os.chmod(path, 0o600)",
        "os.chmod(path, 0o644)",
    ),
    "repl/test_repl_place.py::test_connection_of_process_of_other_user_is_refused": (
        "repl/wire/local_socket.py",
        "return bool(user_id == os.geteuid())",
        "return True",
    ),
    "repl/test_repl_socket.py::test_hostile_bytes_leave_other_clients_served": (
        "repl/wire/serve.py",
        "        except ProtocolError as error:\n"
        "            prompt.send(id=request_id, error=str(error))\n",
        "        except ProtocolError as error:\n            self._end(str(error))\n",
    ),
    "live/test_live_osc.py::test_osc_parse_address_default_host": (
        "ergon/live/osc.py",
        'LOOPBACK = "127.0.0.1"',
        'LOOPBACK = "0.0.0.0"',
    ),
    "live/test_live_osc.py::test_osc_parser_with_random_datagrams": (
        "ergon/live/datagrams.py",
        "        except Exception:  # whatever strange bytes make of a parser\n",
        "        except ImportError:\n",
    ),
    "repl/test_repl_osc.py::test_osc_line_requiring_password_is_refused": (
        "repl/session/osc.py",
        ", refusal_by_command=_TYPED_ONLY)",
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
def test_broken_promise_fails_its_security_test(copied: Path, test: str) -> None:
    name, before, after = BREAKS[test]
    source = copied / name
    text = source.read_text(encoding="utf-8")
    assert before in text
    try:
        source.write_text(text.replace(before, after), encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", f"tests/{test}"],
            cwd=copied,
            env={**os.environ, "PYTHONPATH": str(copied)},
            stdout=subprocess.PIPE,
            text=True,
            timeout=PATIENCE,
        )
    finally:
        source.write_text(text, encoding="utf-8")
    assert done.returncode == 1, done.stdout
    assert "1 failed" in done.stdout


def test_broken_promises_listed_on_security_page() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    for test, (name, before, _) in BREAKS.items():
        assert f"`tests/{test}`" in page
        assert before in (ROOT / name).read_text(encoding="utf-8"), name
