"""Several machines: a remote cache and a cluster, both optional."""
