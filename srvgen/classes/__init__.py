"""From the model of a definition to Python: message classes, stubs, packages, and the import hook.

Start with `loader`, which makes classes at run time, or `generate`, which writes packages; both
use `render`. What generated code itself needs is `srvgen._runtime`."""
