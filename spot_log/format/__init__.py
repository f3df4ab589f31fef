"""What a log contains: records, topics, their protobuf form."""
