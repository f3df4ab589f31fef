"""What training, refinement and identification share: configs, progress, run folders."""
