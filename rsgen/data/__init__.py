"""What a test is: records, response surfaces, and time histories that become one."""
