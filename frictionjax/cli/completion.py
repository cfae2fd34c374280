"""The command `completion`: a script with which a shell completes commands, options, files and names of effects.

The script is written once, by cyclopts, from the commands themselves: nothing of frictionjax runs at a key press.
"""

from typing import TYPE_CHECKING, Literal

from frictionjax.cli.kinds import Screen
from frictionjax.cli.terminal import say

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cyclopts import App


def completion(shell: Literal["bash", "zsh", "fish"], /, *, terminal: Screen) -> None:
    """Print a script with which a shell completes commands and options.

    The shell then completes commands, options, files and names of effects.

    **Arguments:**

    - `shell`: the shell
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax completion bash \\
          > ~/.local/share/bash-completion/completions/frictionjax
        frictionjax completion zsh > ~/.zfunc/_frictionjax
        frictionjax completion fish > ~/.config/fish/completions/frictionjax.fish
    """
    from frictionjax.cli.commands import below, program
    from frictionjax.physics import catalogue

    whole = program(tuple(catalogue()))
    script = whole.generate_completion(shell=shell, prog_name="frictionjax")
    terminal.close()
    say([_with_several(script, below(whole))])


# What cyclopts writes for bash where a value stands: it looks at the word before, which may be another value of the
# same option. The option itself is the last word with a hyphen.
_BEFORE = 'local _value_prev="${prev}"\n'
_OPTION_BEFORE = """\
{indent}local _word
{indent}for ((_word = COMP_CWORD - 1; _word > 1; _word--)); do
{indent}  [[ "${{COMP_WORDS[_word]}}" == -* ]] || continue
{indent}  [[ " {several} " == *" ${{COMP_WORDS[_word]}} "* ]] && _value_prev="${{COMP_WORDS[_word]}}"
{indent}  break
{indent}done
"""


def _with_several(script: str, commands: "Iterable[App]") -> str:
    """The `script`, which then completes in bash also the second value of an option of these `commands`."""
    options = {
        name
        for command in commands
        for argument in command.assemble_argument_collection()
        if argument.parameter.consume_multiple
        for name in argument.parameter.name or ()
    }
    head, *rest = script.split(_BEFORE)
    for part in rest:
        indent = head[len(head.rstrip(" ")) :]
        head += _BEFORE + _OPTION_BEFORE.format(indent=indent, several=" ".join(sorted(options))) + part
    return head
