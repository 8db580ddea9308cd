"""An example of plug-ins: a target, its reader, a check and a collision method."""
