"""The bundled applications, importable as `teg.examples`."""
