"""``uasthn completion``: the script that teaches a shell to complete this command."""

import click
from click.shell_completion import get_completion_class

_INSTALL = """\
\b
Load it in the shell's start-up file:
  bash   echo 'eval "$(uasthn completion bash)"' >> ~/.bashrc
  zsh    echo 'eval "$(uasthn completion zsh)"' >> ~/.zshrc
  fish   uasthn completion fish > ~/.config/fish/completions/uasthn.fish
"""


@click.command(epilog=_INSTALL)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print the completion script of a shell."""
    completion_class = get_completion_class(shell)
    if completion_class is None:
        raise click.UsageError(f"click {click.__version__} knows no completion for {shell}")
    script = completion_class(ctx.find_root().command, {}, "uasthn", "_UASTHN_COMPLETE")
    click.echo(script.source())
