"""The gRPC services of the fake robot, one file a service."""
