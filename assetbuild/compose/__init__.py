"""Parts mounted on a robot: names, tables, control and masks of several as one."""
