"""`ergon completion`: a script that lets the shell complete commands, options, files and names."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import click

from ergon.common.terminal import clean

from .names import SECTIONS, names_of

SHELLS = ("bash", "zsh", "fish")
# Sections of the score whose names complete an option, or the second argument of a command.
_SECTIONS_BY_OPTION = {"--from": ("marks",), "--until": ("marks",), "--key": ("keys",)}
_PLOTTED_SECTIONS = ("gestures", "takes", "players")


@click.command()
@click.argument("shell", type=click.Choice(SHELLS), required=False)
@click.option("--names", "wanted", hidden=True, help="Print names of these sections of a score.")
@click.argument("score_path", required=False)
def completion(shell: str | None, wanted: str | None, score_path: str | None) -> None:
    """Print a completion script for bash, zsh or fish.

    bash: eval "$(ergon completion bash)" in ~/.bashrc. zsh: the same in ~/.zshrc, after compinit.
    fish: ergon completion fish > ~/.config/fish/completions/ergon.fish
    """
    if wanted is not None:
        # Called by the scripts below: `ergon completion --names gestures,takes bash SCORE`.
        sections = tuple(name for name in wanted.split(",") if name in SECTIONS)
        for name in names_of(score_path or "", sections):
            click.echo(clean(name))
        return
    if shell is None:
        raise click.UsageError(f"which shell? {', '.join(SHELLS)}")
    click.echo(_SCRIPTS[shell](), nl=False)


def _parameters_by_command() -> dict[str, list[click.Parameter]]:
    """Every command with its parameters; this imports the commands, but not what they import.

    A group has those of all its commands.
    """
    from .app import group

    return {name: _parameters(command) for name, command in _commands(group).items()}


def _commands(group: click.Group) -> dict[str, click.Command]:
    context = click.Context(group)
    commands = {name: group.get_command(context, name) for name in group.list_commands(context)}
    return {name: command for name, command in commands.items() if command is not None}


def _parameters(command: click.Command) -> list[click.Parameter]:
    if isinstance(command, click.Group):
        subcommand_parameters = {
            p.name: p for c in _commands(command).values() for p in _parameters(c)
        }
        return list(subcommand_parameters.values())
    return [p for p in command.params if not getattr(p, "hidden", False)]


def _subcommands_by_group() -> dict[str, list[str]]:
    """Commands that are groups, with the names of their commands."""
    from .app import group

    commands = _commands(group).items()
    return {name: list(_commands(c)) for name, c in commands if isinstance(c, click.Group)}


def _options(parameters: Iterable[click.Parameter]) -> list[click.Option]:
    return [p for p in parameters if isinstance(p, click.Option)]


def _bash() -> str:
    cases = []
    for name, parameters in _parameters_by_command().items():
        words = [word for p in _options(parameters) for word in (*p.opts, *p.secondary_opts)]
        cases.append(f'    {name}) words="{" ".join(sorted([*words, "--help"]))}" ;;')
    group_cases = [
        f'    {name}) COMPREPLY=($(compgen -W "{" ".join(words)} --help" -- "$cur")); return ;;'
        for name, words in _subcommands_by_group().items()
    ]
    return _BASH.format(
        commands=" ".join(_parameters_by_command()),
        cases="\n".join(cases),
        values=_bash_values(),
        groups="\n".join(group_cases),
    )


def _bash_values() -> str:
    """Shell cases for the word after an option: choices, names of the score, or files."""
    case_lines: dict[str, str] = {}
    for parameters in _parameters_by_command().values():
        for option_parameter in _options(parameters):
            for option_name in option_parameter.opts:
                if option_name in _SECTIONS_BY_OPTION:
                    sections = ",".join(_SECTIONS_BY_OPTION[option_name])
                    case_lines[option_name] = (
                        f'COMPREPLY=($(compgen -W "$(_ergon_names {sections})" -- "$cur"))'
                    )
                elif isinstance(option_parameter.type, click.Choice):
                    choices = " ".join(map(str, option_parameter.type.choices))
                    case_lines[option_name] = f'COMPREPLY=($(compgen -W "{choices}" -- "$cur"))'
                elif (
                    isinstance(option_parameter.type, click.Path)
                    or option_parameter.metavar == "FILE"
                ):
                    case_lines[option_name] = 'COMPREPLY=($(compgen -f -- "$cur"))'
    return "\n".join(
        f"    {word}) {action}; return ;;" for word, action in sorted(case_lines.items())
    )


def _zsh() -> str:
    return "autoload -U +X bashcompinit && bashcompinit\n" + _bash()


def _fish() -> str:
    from .app import COMMANDS
    from .lazy import command_entry

    script_lines = [_FISH]
    for command_name in COMMANDS:
        summary = command_entry(COMMANDS, command_name).help_line
        script_lines.append(
            f"complete -c ergon -n __fish_use_subcommand -f -a {command_name} -d {_quoted(summary)}"
        )
    for command_name, parameters in _parameters_by_command().items():
        condition = f"-n '__fish_seen_subcommand_from {command_name}'"
        for option_parameter in _options(parameters):
            flags = [
                f"-l {word[2:]}" if word.startswith("--") else f"-s {word[1:]}"
                for word in (*option_parameter.opts, *option_parameter.secondary_opts)
            ]
            complete_line = (
                f"complete -c ergon {condition} {' '.join(flags)} -d "
                f"{_quoted(option_parameter.help or '')}"
            )
            sections = next(
                (
                    _SECTIONS_BY_OPTION[word]
                    for word in option_parameter.opts
                    if word in _SECTIONS_BY_OPTION
                ),
                None,
            )
            if sections is not None:
                complete_line += f" -xa '(__ergon_names {','.join(sections)})'"
            elif isinstance(option_parameter.type, click.Choice):
                complete_line += (
                    f" -xa {_quoted(' '.join(map(str, option_parameter.type.choices)))}"
                )
            elif not option_parameter.is_flag:
                complete_line += " -r"
            script_lines.append(complete_line)
    plotted_sections = ",".join(_PLOTTED_SECTIONS)
    script_lines.append(
        "complete -c ergon -n '__fish_seen_subcommand_from plot; and __ergon_score >/dev/null' "
        f"-a '(__ergon_names {plotted_sections})'"
    )
    for command_name, group_words in _subcommands_by_group().items():
        script_lines.append(
            f"complete -c ergon -n '__fish_seen_subcommand_from {command_name}' -f -a "
            f"'{' '.join(group_words)}'"
        )
    shells = " ".join(SHELLS)
    script_lines.append(
        f"complete -c ergon -n '__fish_seen_subcommand_from completion' -f -a '{shells}'"
    )
    return "\n".join(script_lines) + "\n"


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


_BASH = """\
# Completion of ergon, made by ergon completion.
_ergon_score() {{
  local word
  for word in "${{COMP_WORDS[@]:2}}"; do
    case "$word" in *.yaml|*.yml) [ -f "$word" ] && printf '%s' "$word" && return ;; esac
  done
}}
_ergon_names() {{
  local score; score="$(_ergon_score)"
  [ -n "$score" ] && ergon completion --names "$1" bash "$score" 2>/dev/null
}}
_ergon() {{
  local cur="${{COMP_WORDS[COMP_CWORD]}}" prev="${{COMP_WORDS[COMP_CWORD-1]}}" words="" score
  COMPREPLY=()
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{commands} --help --version --debug" -- "$cur"))
    return
  fi
  [ "$COMP_CWORD" -eq 2 ] && case "${{COMP_WORDS[1]}}" in
{groups}
  esac
  case "$prev" in
{values}
  esac
  case "${{COMP_WORDS[1]}}" in
{cases}
  esac
  if [[ "$cur" == -* ]]; then
    COMPREPLY=($(compgen -W "$words" -- "$cur"))
    return
  fi
  case "${{COMP_WORDS[1]}}" in
    completion) COMPREPLY=($(compgen -W "bash zsh fish" -- "$cur")); return ;;
    plot)
      score="$(_ergon_score)"
      if [ -n "$score" ] && [ "$score" != "$cur" ]; then
        COMPREPLY=($(compgen -W "$(_ergon_names gestures,takes,players)" -- "$cur"))
        return
      fi ;;
  esac
  COMPREPLY=($(compgen -f -X '!*.y?(a)ml' -- "$cur") $(compgen -d -- "$cur"))
  case "${{COMP_WORDS[1]}}" in
    info|plot|take) COMPREPLY+=($(compgen -f -X '!*.@(take|wav|csv|npz)' -- "$cur")) ;;
  esac
}}
shopt -s extglob 2>/dev/null || setopt kshglob 2>/dev/null
complete -o filenames -F _ergon ergon
"""

_FISH = """\
# Completion of ergon, made by ergon completion.
function __ergon_score
    for word in (commandline -opc)
        if string match -qr '\\.ya?ml$' -- $word; and test -f $word
            echo $word
            return 0
        end
    end
    return 1
end
function __ergon_names
    set -l score (__ergon_score); or return
    ergon completion --names $argv[1] fish $score 2>/dev/null
end"""

_SCRIPTS: dict[str, Callable[[], str]] = {"bash": _bash, "zsh": _zsh, "fish": _fish}
