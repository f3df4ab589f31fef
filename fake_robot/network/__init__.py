"""What crosses the network: message streams with delays and losses, and the port that services use."""
