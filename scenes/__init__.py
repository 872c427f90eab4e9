"""The scenes that ship with the package, one TOML file each."""
