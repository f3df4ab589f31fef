"""Who the robot is: authentication, directory, licences, time sync."""
