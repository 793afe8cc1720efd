"""What `cosim` alone says: the first commands, in the order in which they make sense."""

FIRST_HOUR = """\
Usage: cosim COMMAND [OPTIONS]

Design, prove and co-simulate control over slow links.
A first hour, in this order:

  cosim demo
      one survey by late fixes, two designs, in a picture
  cosim trace report traces/auv-survey.mcap
      what happened in the first run, as a page
  cosim design paper --search --save gain.json
      a gain with its proof; your own system: a TOML file
  cosim scenario new mine
      a scenario to change; then: cosim run mine.toml

cosim --help                 lists all commands
cosim COMMAND --help         explains one, with examples
cosim --install-completion   completes them in your shell"""
