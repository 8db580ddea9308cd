"""Physics engines that checks call, one file each."""
