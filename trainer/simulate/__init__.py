"""Where independent jobs are computed: this process, several, or a Ray cluster."""
