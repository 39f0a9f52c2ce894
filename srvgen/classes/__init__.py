"""From the model to Python: message classes, packages, stubs and the import hook.

Start with `loader`, which makes classes at run time, or `generate`, which makes the files of
packages; both use `render`. The base classes of all messages are in `srvgen._runtime`, the
encodings in `srvgen.cdr` and `srvgen.convert`."""
