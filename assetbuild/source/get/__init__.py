"""Fetch and unpack: wheels, archives, git commits, folders."""
