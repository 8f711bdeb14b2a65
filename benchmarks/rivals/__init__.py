"""What others would write or already wrote, to be measured beside ours."""
