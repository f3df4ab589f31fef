"""The locomotion task: observations, rewards, resets, commands."""
