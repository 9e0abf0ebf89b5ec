"""The commands of `drop` as functions: paths in, a typed result out."""
