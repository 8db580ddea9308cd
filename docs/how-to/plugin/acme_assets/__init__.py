"""An example of plug-ins: a target, its reader, a check, an edit and a collision method."""
